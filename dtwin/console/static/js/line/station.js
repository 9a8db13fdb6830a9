// Level 3: the arm of a station by selection: what it does and can do, why, and its joints as long as its readings come.
import { drawArm } from "../arm.js";
import { chainView, drawChain } from "../chain.js";
import { el, figures, number, panel, rebuild, setText, table } from "../dom.js";
import { drawIndicators } from "../indicator.js";
import { commandOf, DASHES, spanOf, titled } from "../joints.js";
import { store, THREE } from "../store.js";
import { drawTrend } from "../trend.js";
import { ability, box, decisionRows, doing, makeDesk, oee, operationsOf, percent, plan, stationButtons, told, twinUnheard } from "./about.js";

const DIGITS = [2, 1, 2];
const FAR = 100;
// Widths of what a station shows, for arms of a few joints and of many.
const USUAL = ["w4", "w3", "w5", "w12"];
const MANY = ["w3", "w4", "w9", "w8"];
// Age from which on readings count as stale, s.
const STALE = 1;

/** A station as it was built; null before that was told. */
const builtOf = (name) => plan()?.zones.flatMap(({ stations }) => stations).find((each) => each.name === name) ?? null;

/** The places of a station's cell as they are drawn. */
function placesOf(name) {
  return Object.fromEntries(Object.entries(builtOf(name)?.places ?? {}).map(([place, [x, y]]) => [place, { x, y }]));
}

/** The joints of a station's arm: of the usual one, or of one of another kind, which its plan tells. */
function makeArm(name, changed) {
  const built = builtOf(name);
  const chain = Boolean(built?.joints?.length);
  const joints = chain ? built.joints : THREE;
  const lengths = joints.map(({ turns }) => (turns ? "rad" : "m"));
  const units = joints.map(({ command }, k) => [lengths[k], `m${lengths[k]} off`, command]);
  const arm = el("canvas", { class: "arm", role: "img", "aria-label": `The arm of ${name}${chain ? ", drawn from its joints; drag to turn it" : " from the side, drawn from its angles"}` });
  const view = chain ? chainView(arm, joints, built.tool, changed) : null;
  const indicators = joints.map((joint) => el("canvas", { class: "indicator", role: "img", "aria-label": `${titled(joint.name)}: position, distance from the path, command` }));
  const values = joints.map((_, k) => units[k].map(() => el("dd", { class: "value" })));
  const readings = values.map((three, k) => el("dl", { class: "readings" }, ...three.map((value, n) => el("div", {}, el("dt", {}, units[k][n]), value))));
  const columns = joints.map((joint, k) => el("div", { class: "fill" }, el("h3", {}, titled(joint.name)), indicators[k], readings[k]));

  function draw(frame) {
    if (view) drawChain(view, frame, built.points);
    else drawArm(arm, frame, placesOf(name));
    joints.forEach((joint, k) => {
      const [position, path, command] = [frame?.theta?.[k], frame?.path?.[k], frame?.volts?.[k]];
      const error = position != null && path != null ? 1000 * (position - path) : null;
      drawIndicators(indicators[k], [
        { ...spanOf(joint), value: position, target: path },
        { low: -FAR * 1.2, high: FAR * 1.2, value: error, band: [-30, 30], limits: [-FAR, FAR] },
        commandOf(joint, command),
      ]);
      [position, error, command].forEach((value, n) => setText(values[k][n], number(value, DIGITS[n] - (joints.length > 3 && n === 2 ? 1 : 0))));
    });
  }
  const unit = lengths.includes("m") ? "mrad or mm" : "mrad";
  return { arm, columns, draw, joints, unit };
}

export function makeStation(name) {
  const arm = el("canvas", { class: "arm" });
  const joints = el("div", { class: "joints fill-row" });
  const reading = el("p", { class: "value", role: "status" });
  const trend = el("canvas", { class: "trend grow", role: "img", "aria-label": "Distance of the joints from their path, last minute" });
  const facts = el("div", { class: "value" });
  const findings = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Findings and decisions about ${name}` });
  const desk = el("div");
  const buttons = el("div", { class: "row" });
  let made = null;
  let drawn = null;
  const parts = [
    panel(`Station ${name}`, "w4", el("div", { class: "row" }, buttons, desk), facts),
    panel("Its arm", "w3", reading, arm),
    panel("Joints", "w5", joints, trend),
    panel("Findings and decisions", "w12", findings),
  ];
  const node = el("div", { class: "grid filling station" }, ...parts);

  /** Makes the arm anew when another one was told. */
  function take(built) {
    if (drawn?.built === built) return;
    const before = drawn?.arm ?? arm;
    drawn = { ...makeArm(name, () => draw()), built };
    before.replaceWith(drawn.arm);
    // Many joints take the upper row, beside what the station does; the arm is drawn below them then.
    const many = drawn.joints.length > 3;
    for (const each of [node, joints]) each.classList.toggle("many", many);
    parts.forEach((part, k) => { part.className = `panel ${(many ? MANY : USUAL)[k]}`; });
    node.append(...(many ? [0, 2, 1, 3] : [0, 1, 2, 3]).map((k) => parts[k]));
    joints.replaceChildren(...drawn.columns);
  }
  function state() {
    const line = told();
    take(JSON.stringify(builtOf(name)?.joints ?? null));
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
      ...(station.settings ? [["Other settings", station.settings]] : []),
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
    if (!drawn) return;
    drawn.draw(shown?.theta ? shown : null);
    drawTrend(trend, trends, {
      title: `Off the path, joints ${drawn.joints.map((_, k) => `${k + 1} ${DASHES[k] ?? ""}`).join(", ")}`, unit: drawn.unit, least: 30,
      lines: drawn.joints.map((_, k) => ({ of: (value) => 1000 * (value(`theta_${k + 1}`) - value(`path_${k + 1}`)), dash: k })),
    });
  }
  return { node, state, draw };
}
