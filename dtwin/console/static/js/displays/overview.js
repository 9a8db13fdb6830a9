// Level 1: the cell at a glance.
import { el, figures, number, panel, rebuild, setText, short, table } from "../dom.js";
import { commandButton } from "../command.js";
import { drawArm } from "../arm.js";
import { chainView, drawChain } from "../chain.js";
import { drawIndicators } from "../indicator.js";
import { commandOf, DASHES, spanOf, titled } from "../joints.js";
import { drawTrend } from "../trend.js";
import { store } from "../store.js";

const FAR = 100;
const DIGITS = [3, 1, 2];

export function makeOverview() {
  const joints = store.joints;
  const chain = Boolean(store.state?.joints?.length);
  const lengths = joints.map(({ turns }) => (turns ? "rad" : "m"));
  const units = joints.map(({ command }, k) => [lengths[k], `m${lengths[k]} off`, command]);
  const arm = el("canvas", { class: "arm", role: "img", "aria-label": chain ? "The arm, drawn from its joints; drag to turn it" : "The arm from the side, drawn from its angles" });
  const view = chain ? chainView(arm, joints, store.state.tool, () => draw()) : null;
  const scene = el("div", { class: "fill" }, arm);
  const indicators = joints.map(({ name }) =>
    el("canvas", { class: "indicator", role: "img", "aria-label": `${titled(name)}: position, distance from the path, command` }));
  const values = joints.map((_, k) => units[k].map(() => el("dd", { class: "value" })));
  const readings = values.map((three, k) => el("dl", { class: "readings" }, ...three.map((value, n) => el("div", {}, el("dt", {}, units[k][n]), value))));
  const trend = el("canvas", { class: "trend low", role: "img", "aria-label": "Distance of the joints from their path, last minute" });
  const figure = el("div", { class: "value" });
  const boxes = el("div");
  const services = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Services" });
  const events = el("div", { class: "scroll short", tabindex: "0", role: "region", "aria-label": "Last events" });
  const release = commandButton({ name: "release", title: "Release the arm", confirm: "The arm moves again, from where it is to where it was going." });
  const many = joints.length > 3;
  const work = panel("Work", "w3", figure, chain && !Object.keys(store.state.points ?? {}).length ? null : el("h3", {}, "Boxes"), boxes);
  const node = el(
    "div", { class: "grid overview" },
    panel("The arm", "w3", scene, el("div", { class: "row" }, release.node)),
    panel("Joints", many ? "w9" : "w6",
      el("div", { class: `joints fill-row${joints.length > 3 ? " many" : ""}` }, ...joints.map(({ name }, k) => el("div", { class: "fill" }, el("h3", {}, titled(name)), indicators[k], readings[k]))),
      trend,
      el("p", { class: "legend" }, "▷ target of the path; ◀ measured; grey: normal band; thick line: limit; ↑ ↓ off scale")),
    ...(many ? [panel("Services", "w5", services), work, panel("Last events", "w4", events)]
      : [work, panel("Services", "w7", services), panel("Last events", "w5", events)]),
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
    ]) : chain ? null : el("p", { class: "why-not" }, "Nobody counts them: there is no supervisor."));
    rebuild(services, now.services, () => table("What each service says of itself", ["Service", "State", "Rate, 1/s", "Restarts", "Reason"],
      worstFirst(now.services).map(([name, health]) => [name, mark(health.state), short(health.rate_hz, 4), String(health.restarts || ""), health.reason]), { numeric: [2, 3], empty: "No service has told how it does." }));
    rebuild(events, now.events.slice(-20), () => table("Plant time, newest first", ["s", "Kind", "What"],
      now.events.slice(-20).reverse().map((event) => [number(event.time, 2), event.kind.replaceAll("_", " "), event.text]), { numeric: [0], empty: "Nothing has happened since the console listens." }));
  }

  function draw() {
    const frame = store.frame;
    if (view) drawChain(view, frame, store.state?.points);
    else drawArm(arm, frame, store.state?.places);
    const expected = (store.state?.model ?? store.state?.settings)?.predicted;
    indicators.forEach((canvas, k) => {
      const error = frame?.theta && frame.path ? 1000 * (frame.theta[k] - frame.path[k]) : null;
      const bound = expected ? 1500 * expected[k] + 10 : null;
      drawIndicators(canvas, [
        { ...spanOf(joints[k]), value: frame?.theta?.[k], target: frame?.path?.[k] },
        { low: -FAR * 1.2, high: FAR * 1.2, value: error, band: bound ? [-bound, bound] : [-30, 30], limits: [-FAR, FAR] },
        commandOf(joints[k], frame?.volts?.[k]),
      ]);
      [frame?.theta?.[k], error, frame?.volts?.[k]].forEach((value, n) => setText(values[k][n], number(value, DIGITS[n] - (many && n !== 1 ? 1 : 0))));
    });
    drawTrend(trend, store.trends, {
      title: `Off the path, joints ${joints.map((_, k) => `${k + 1} ${DASHES[k] ?? ""}`).join(", ")}`, unit: lengths.includes("m") ? "mrad or mm" : "mrad", least: 30,
      lines: joints.map((_, k) => ({ of: (v) => 1000 * (v(`theta_${k + 1}`) - v(`path_${k + 1}`)), dash: k })),
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
