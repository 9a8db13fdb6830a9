// Level 2: is it still that arm? Measured against predicted, residuals, evidence, findings.
import { column, el, panel, rebuild, setText, table } from "../dom.js";
import { acknowledgeFindings, learnNormal } from "../findings.js";
import { commandButton } from "../command.js";
import { drawTrend } from "../trend.js";
import { store } from "../store.js";

const SIGMAS = 4;
const WIDEST = 3;

export function makeMonitoring() {
  const faces = store.joints;
  const chain = Boolean(store.state?.joints?.length);
  const joints = faces.map((_, k) => k + 1);
  const canvas = (words, kind = "trend low") => el("canvas", { class: kind, role: "img", "aria-label": words });
  const angles = joints.map((joint) => canvas(`${faces[joint - 1].name}: measured and ${chain ? "desired position" : "predicted angle"}`));
  const residuals = joints.map((joint) => canvas(`${faces[joint - 1].name}: ${chain ? "distance from its path" : "residual with its band"}`));
  const evidence = canvas("Evidence of a sudden change with its threshold", "trend");
  const findings = el("div");
  const words = el("div", { class: "scroll short", tabindex: "0", role: "region", "aria-label": "What the monitor says" });
  const acknowledge = acknowledgeFindings();
  const learn = learnNormal();
  const fault = el("input", { id: "fault", value: "K2*=0.1@0", "aria-describedby": "fault-help" });
  const inject = commandButton({
    name: "fault", title: "Inject the fault", form: () => ({ fault: fault.value }),
    confirm: () => `For training: the emulated machine gets the fault ${fault.value} now. The arm may move otherwise.`,
  });
  const watch = commandButton({ name: "watch", title: "Start the monitor" });
  const leave = commandButton({ name: "leave", title: "Stop the monitor", confirm: "Nothing is found any more, and no finding stops the arm, until the monitor is started again." });
  const model = el("p", { class: "quiet" });
  const buttons = [acknowledge, learn, inject, watch, leave];
  const node = el(
    "div", { class: `grid filling headed${joints.length > 3 ? " many" : ""}` },
    panel("Findings", "w8", findings, model, el("div", { class: "row" }, acknowledge.node, learn.node, watch.node, leave.node)),
    column("w4", panel(chain ? "What the monitor says" : "Evidence", "grow", chain ? null : evidence, words),
      panel("Training: faults of the emulated machine", "",
        el("div", { class: "row" }, el("label", { for: "fault" }, "Fault"), fault, inject.node),
        el("span", { id: "fault-help", class: "quiet" }, `as for dtwin run --fault; @0 begins now: ${chain ? "bias2+=0.01@0" : "K2*=0.1@0"}, lock3@0`))),
    panel(chain ? "Measured — and desired – –, the last 20 s" : "Measured — and predicted – –, the last 20 s", "w6", ...angles),
    panel(chain ? "Distance from the path" : "Residuals, with the band of a healthy arm", "w6", ...residuals),
  );

  function state() {
    buttons.forEach((button) => button.refresh());
    const verdict = store.state?.verdict;
    const watched = store.state?.watch;
    setText(model, watched ? `${watched.running ? "Watched with" : "Stopped; would watch with"}: ${watched.model}` : "");
    rebuild(findings, verdict?.units, () => verdict
      ? table("What the monitor says of each part of the arm", ["Part", "State", "Changed", "Cause and size"],
        Object.entries(verdict.units).map(([name, unit]) => [name, mark(unit.state), unit.parameter, unit.text]),
        { empty: "The monitor has not judged any part yet." })
      : el("p", {}, "Nobody watches the arm."));
    const said = verdict && [verdict.forecasts, verdict.unobservable, verdict.missed, verdict.restarts];
    rebuild(words, said, () => verdict && [
      verdict.forecasts.length || chain ? null : el("p", { class: "why-not" }, "No slow change is on its way to a limit."),
      ...verdict.forecasts.map((text) => el("p", {}, `forecast: ${text}`)),
      el("p", { class: "quiet" }, verdict.unobservable.length ? `The last seconds could not show: ${verdict.unobservable.join(", ")}.` : ""),
      el("p", { class: "quiet" }, `Samples missed: ${verdict.missed}; estimates started anew: ${verdict.restarts}`),
    ]);
  }

  function draw() {
    const trends = store.trends;
    if (chain) {
      joints.forEach((joint, k) => {
        const unit = faces[k].turns ? "rad" : "m";
        drawTrend(angles[k], trends, { title: faces[k].name, unit, span: 20, lines: [{ of: (v) => v(`theta_${joint}`) }, { of: (v) => v(`path_${joint}`) }] });
        drawTrend(residuals[k], trends, { title: faces[k].name, unit: `m${unit}`, least: 1, lines: [{ of: (v) => 1000 * (v(`theta_${joint}`) - v(`path_${joint}`)) }] });
      });
      return;
    }
    const scale = (store.frame?.deviation ?? [0.001, 0.001, 0.001]).map((deviation) => 1000 * SIGMAS * deviation);
    joints.forEach((joint, k) => {
      const residual = (v) => 1000 * v(`residual_${joint}`);
      const width = (v) => 1000 * SIGMAS * v(`deviation_${joint}`);
      drawTrend(angles[k], trends, {
        title: `Joint ${joint}`, unit: "rad", span: 20,
        lines: [{ of: (v) => v(`predicted_${joint}`) + v(`residual_${joint}`) }, { of: (v) => v(`predicted_${joint}`) }],
        band: { low: (v) => v(`predicted_${joint}`) - SIGMAS * v(`deviation_${joint}`), high: (v) => v(`predicted_${joint}`) + SIGMAS * v(`deviation_${joint}`) },
      });
      drawTrend(residuals[k], trends, {
        title: `Joint ${joint}`, unit: "mrad", range: [-WIDEST * scale[k], WIDEST * scale[k]],
        lines: [{ of: residual }], band: { low: (v) => -width(v), high: width },
      });
    });
    const threshold = store.frame?.threshold ?? NaN;
    drawTrend(evidence, trends, { title: "2 log likelihood ratio", unit: "–", least: 5, lines: [{ of: (v) => v("evidence") }], levels: [{ value: threshold, name: "threshold" }] });
  }
  return { node, state, draw };
}

const mark = (state) => {
  if (state === "nominal") return "nominal";
  return el("span", { class: `tag ${state === "failed" ? "severe" : "warn"}` }, `${state === "failed" ? "▲" : "△"} ${state}`);
};
