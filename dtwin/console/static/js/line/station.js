// Level 3: the arm of a station by selection: what it does and can do, why, and its joints as long as its readings come.
import { drawArm } from "../arm.js";
import { el, figures, number, panel, rebuild, setText, table } from "../dom.js";
import { drawIndicators } from "../indicator.js";
import { store } from "../store.js";
import { drawTrend } from "../trend.js";
import { ability, box, decisionRows, doing, makeDesk, oee, operationsOf, percent, plan, stationButtons, told, twinUnheard } from "./about.js";

const JOINTS = [1, 2, 3];
const UNITS = ["rad", "mrad off", "V"];
const DIGITS = [2, 1, 2];
const [VOLTS, FAR] = [8, 100];
// Age from which on readings count as stale, s.
const STALE = 1;

/** The places of a station's cell as they are drawn. */
function placesOf(name) {
  const built = plan()?.zones.flatMap(({ stations }) => stations).find((each) => each.name === name);
  return Object.fromEntries(Object.entries(built?.places ?? {}).map(([place, [x, y]]) => [place, { x, y }]));
}

export function makeStation(name) {
  const arm = el("canvas", { class: "arm", role: "img", "aria-label": `The arm of ${name} from the side, drawn from its angles` });
  const reading = el("p", { class: "value", role: "status" });
  const indicators = JOINTS.map((joint) => el("canvas", { class: "indicator", role: "img", "aria-label": `Joint ${joint}: angle, distance from the path, voltage` }));
  const values = JOINTS.map(() => UNITS.map(() => el("dd", { class: "value" })));
  const readings = values.map((three) => el("dl", { class: "readings" }, ...three.map((value, n) => el("div", {}, el("dt", {}, UNITS[n]), value))));
  const trend = el("canvas", { class: "trend grow", role: "img", "aria-label": "Distance of the joints from their path, last minute" });
  const facts = el("div", { class: "value" });
  const findings = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Findings and decisions about ${name}` });
  const desk = el("div");
  const buttons = el("div", { class: "row" });
  let made = null;
  const node = el("div", { class: "grid filling station" },
    panel(`Station ${name}`, "w4", el("div", { class: "row" }, buttons, desk), facts),
    panel("Its arm", "w3", reading, arm),
    panel("Joints", "w5", el("div", { class: "joints fill-row" }, ...JOINTS.map((joint, k) => el("div", { class: "fill" }, el("h3", {}, `Joint ${joint}`), indicators[k], readings[k]))), trend),
    panel("Findings and decisions", "w12", findings));

  function state() {
    const line = told();
    const station = line?.stations.find((each) => each.name === name);
    if (!station) {
      rebuild(facts, [Boolean(line), store.state?.line?.lost], () => el("p", { class: "why-not" }, line ? `There is no station ${name}.` : store.state?.line?.lost || "Nothing is heard of the line yet."));
      return;
    }
    if (made?.zone !== station.zone) {
      made = { zone: station.zone, desk: makeDesk(station.zone), buttons: stationButtons(name, station.zone) };
      desk.replaceChildren(made.desk.node);
      buttons.replaceChildren(...made.buttons.nodes);
    }
    made.desk.refresh();
    made.buttons.refresh();
    const others = Object.keys(line.set_up).filter((operation) => station.able.includes(operation) && line.set_up[operation] !== name);
    rebuild(facts, [station, line.set_up], () => figures([
      ["Zone", el("a", { href: `#zone/${station.zone}` }, station.zone)],
      ["Now", doing(station)],
      ["Its arm can do", ability(station)],
      ["Why", station.why],
      ...(station.target_time ? [["Other settings", `a model of what it is, ${number(station.target_time, 1)} s for a motion`]] : []),
      ["Does", operationsOf(name).join(", ") || "nothing"],
      ["Could do, too", twinUnheard() ? "not known" : others.join(", ") || "nothing"],
      ["Waits, work, done", `${box(station.waiting)}, ${box(station.worked)}, ${box(station.finished)}`],
      ["OEE, 10 minutes", percent(oee(station))],
      ["Availability", percent(station.availability)],
      ["Performance", percent(station.performance)],
      ["Quality", percent(station.quality)],
    ]));
    const about = line.decisions.filter((each) => each.station === name);
    rebuild(findings, about, () => table("Plant time, newest first", ["s", "Who", "What", "Why"], decisionRows(about), { numeric: [0], empty: `Nothing of the last decisions is about ${name}.` }));
  }
  function draw() {
    const { frame, received, trends, name: heard } = store.station;
    const shown = heard === name ? frame : null;
    const age = shown?.age == null ? Infinity : shown.age + (performance.now() - received) / 1000;
    setText(reading, !shown?.theta ? "No readings of this arm arrive." : age > STALE ? `▲ stale: last sample ${age.toFixed(0)} s ago` : `● live, ${number(shown.time, 1)} s`);
    node.classList.toggle("stale-arm", age > STALE);
    drawArm(arm, shown?.theta ? shown : null, placesOf(name));
    JOINTS.forEach((_, k) => {
      const [angle, path, volts] = [shown?.theta?.[k], shown?.path?.[k], shown?.volts?.[k]];
      const error = angle != null && path != null ? 1000 * (angle - path) : null;
      drawIndicators(indicators[k], [
        { low: -4.2, high: 4.2, value: angle, target: path },
        { low: -FAR * 1.2, high: FAR * 1.2, value: error, band: [-30, 30], limits: [-FAR, FAR] },
        { low: -9, high: 9, value: volts, limits: [-VOLTS, VOLTS] },
      ]);
      [angle, error, volts].forEach((value, n) => setText(values[k][n], number(value, DIGITS[n])));
    });
    drawTrend(trend, trends, {
      title: "Off the path, joints 1 —, 2 – –, 3 · ·", unit: "mrad", least: 30,
      lines: JOINTS.map((joint, k) => ({ of: (value) => 1000 * (value(`theta_${joint}`) - value(`path_${joint}`)), dash: k })),
    });
  }
  return { node, state, draw };
}
