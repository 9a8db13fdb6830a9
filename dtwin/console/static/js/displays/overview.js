// Level 1: the cell at a glance.
import { el, figures, number, panel, rebuild, setText, short, table } from "../dom.js";
import { commandButton } from "../command.js";
import { drawArm } from "../arm.js";
import { drawIndicators } from "../indicator.js";
import { drawTrend } from "../trend.js";
import { store } from "../store.js";

const LIMIT = 8;
const FAR = 100;
const UNITS = ["rad", "mrad off", "V"];
const DIGITS = [3, 1, 2];

export function makeOverview() {
  const arm = el("canvas", { class: "arm", role: "img", "aria-label": "The arm from the side, drawn from its angles" });
  const scene = el("div", { class: "fill" }, arm);
  const indicators = [1, 2, 3].map((joint) =>
    el("canvas", { class: "indicator", role: "img", "aria-label": `Joint ${joint}: angle, distance from the path, voltage` }));
  const values = [1, 2, 3].map(() => UNITS.map(() => el("dd", { class: "value" })));
  const readings = values.map((three) => el("dl", { class: "readings" }, ...three.map((value, k) => el("div", {}, el("dt", {}, UNITS[k]), value))));
  const trend = el("canvas", { class: "trend low", role: "img", "aria-label": "Distance of the joints from their path, last minute" });
  const figure = el("div", { class: "value" });
  const boxes = el("div");
  const services = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Services" });
  const events = el("div", { class: "scroll short", tabindex: "0", role: "region", "aria-label": "Last events" });
  const release = commandButton({ name: "release", title: "Release the arm", confirm: "The arm moves again, from where it is to where it was going." });
  const node = el(
    "div", { class: "grid overview" },
    panel("The arm", "w3", scene, el("div", { class: "row" }, release.node)),
    panel("Joints", "w6",
      el("div", { class: "joints fill-row" }, ...[0, 1, 2].map((k) => el("div", { class: "fill" }, el("h3", {}, `Joint ${k + 1}`), indicators[k], readings[k]))),
      trend,
      el("p", { class: "legend" }, "▷ target of the path; ◀ measured; grey: normal band; thick line: limit; ↑ ↓ off scale")),
    panel("Work", "w3", figure, el("h3", {}, "Boxes"), boxes),
    panel("Services", "w7", services),
    panel("Last events", "w5", events),
  );
  let viewer = null;

  function state() {
    release.refresh();
    const now = store.state;
    if (!viewer && store.session?.viewer && webgl()) {
      viewer = el("iframe", { class: "viewer", title: "The arm in 3D", src: store.session.viewer });
      scene.prepend(viewer);
    }
    if (viewer) {
      viewer.hidden = Boolean(store.past);
      arm.hidden = !viewer.hidden;
    }
    if (!now) return;
    const latency = now.latency_ms;
    rebuild(figure, [now.ticks, now.late_ticks, now.real_time_factor, latency, Math.round(store.latency ?? 0)], () => figures([
      ["Real-time factor", short(now.real_time_factor, 3)],
      ["Sample to command", latency ? `${number(latency.p50, 2)} ms, 99 %: ${number(latency.p99, 2)} ms` : "–"],
      ["Late ticks", `${now.late_ticks} of ${now.ticks}`],
      ["Sample to pixels", store.latency == null ? "–" : `${Math.round(store.latency)} ms`],
    ]));
    rebuild(boxes, now.boxes, () => now.boxes ? figures([
      ["Delivered", now.boxes.delivered], ["Picked", now.boxes.picked], ["Arrived", now.boxes.arrived],
      ["Misplaced", now.boxes.misplaced], ["Turned away", now.boxes.turned_away], ["Held", now.boxes.held],
    ]) : el("p", { class: "why-not" }, "Nobody counts them: there is no supervisor."));
    rebuild(services, now.services, () => table("What each service says of itself", ["Service", "State", "Rate, 1/s", "Restarts", "Reason"],
      worstFirst(now.services).map(([name, health]) => [name, mark(health.state), short(health.rate_hz, 4), String(health.restarts || ""), health.reason]), { numeric: [2, 3], empty: "No service has told how it does." }));
    rebuild(events, now.events.slice(-20), () => table("Plant time, newest first", ["s", "Kind", "What"],
      now.events.slice(-20).reverse().map((event) => [number(event.time, 2), event.kind.replaceAll("_", " "), event.text]), { numeric: [0], empty: "Nothing has happened since the console listens." }));
  }

  function draw() {
    const frame = store.frame;
    drawArm(arm, frame, store.state?.places);
    const expected = store.state?.settings?.predicted;
    indicators.forEach((canvas, k) => {
      const error = frame?.theta && frame.path ? 1000 * (frame.theta[k] - frame.path[k]) : null;
      const bound = expected ? 1500 * expected[k] + 10 : null;
      drawIndicators(canvas, [
        { low: -Math.PI * 1.2, high: Math.PI * 1.2, value: frame?.theta?.[k], target: frame?.path?.[k] },
        { low: -FAR * 1.2, high: FAR * 1.2, value: error, band: bound ? [-bound, bound] : [-30, 30], limits: [-FAR, FAR] },
        { low: -9, high: 9, value: frame?.volts?.[k], limits: [-LIMIT, LIMIT] },
      ]);
      [frame?.theta?.[k], error, frame?.volts?.[k]].forEach((value, n) => setText(values[k][n], number(value, DIGITS[n])));
    });
    drawTrend(trend, store.trends, {
      title: "Off the path, joints 1 —, 2 – –, 3 · ·", unit: "mrad", least: 30,
      lines: [1, 2, 3].map((joint, k) => ({ of: (v) => 1000 * (v(`theta_${joint}`) - v(`path_${joint}`)), dash: k })),
    });
  }
  return { node, state, draw };
}

const GOOD = ["running", "waiting"];
const worstFirst = (services) => Object.entries(services).sort(([, a], [, b]) => GOOD.includes(a.state) - GOOD.includes(b.state));
const mark = (state) => (GOOD.includes(state) ? state : el("span", { class: "tag warn" }, `△ ${state}`));

function webgl() {
  try {
    // A renderer in software would take the time that the rest of the page needs.
    return Boolean(document.createElement("canvas").getContext("webgl2", { failIfMajorPerformanceCaveat: true }));
  } catch {
    return false;
  }
}
