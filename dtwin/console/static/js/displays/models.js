// Level 2, for any arm: which model its blocks reckon with, the trial of a new one, and how it is identified at work.
import { column, el, number, panel, rebuild, short, table } from "../dom.js";
import { commandButton } from "../command.js";
import { field, form } from "../fields.js";
import { store } from "../store.js";
import { makeProposals } from "./proposals.js";

const NINETY_FIVE = 1.96;
const LAST = { start: "Found in force", upload: "Uploaded", refuse: "Another one was refused", confirm: "Confirmed", "roll back": "Rolled back" };

export function makeModels() {
  const faces = store.joints;
  const inForce = el("div", { role: "status" });
  const said = el("div", { role: "status" });
  const progress = el("progress", { "aria-label": "Motion taken for the identification" });
  const parameters = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Parameters" });
  const name = field("Name to keep it under", { maxlength: 60 }, "arm");
  const upload = el("input", { type: "checkbox", id: "with-upload", checked: true });
  const anyway = el("input", { type: "checkbox", id: "anyway" });
  const proposals = makeProposals();
  const rollback = commandButton({ name: "rollback", title: "Roll back", confirm: "The model before the one on trial is in force again at once: the arm may move otherwise." });
  const start = commandButton({ name: "identify", title: "Identify from the motion" });
  const accept = commandButton({
    name: "accept", title: "Accept the model", form: () => ({ name: name.input.value, upload: upload.checked, anyway: anyway.checked }),
    confirm: () => (upload.checked ? "The model is kept, and the blocks reckon with it, on trial." : "The model is kept; the blocks go on with theirs."),
  });
  const reject = commandButton({ name: "reject", title: "Reject the model" });
  const buttons = [rollback, start, accept, reject];
  const node = el(
    "div", { class: "grid filling" },
    column("w5",
      panel("The model in force", "", inForce, el("div", { class: "row" }, rollback.node)),
      panel("Identify at work", "", said, progress, el("div", { class: "row" }, start.node)),
      panel("Decide", "grow", el("div", { class: "stack" }, form(name),
        el("span", {}, upload, " ", el("label", { for: "with-upload" }, "upload it to the blocks, on trial")),
        el("span", {}, anyway, " ", el("label", { for: "anyway" }, "keep it even if it is in doubt")),
        el("div", { class: "row" }, accept.node, reject.node)))),
    column("w7", panel("Parameters", "grow", parameters), panel("Proposals of recovery", "", proposals.node)),
  );

  function state() {
    buttons.forEach((button) => button.refresh());
    proposals.state?.();
    const model = store.state?.model;
    rebuild(inForce, model, () => model ? [
      el("p", {}, el("strong", {}, `Version ${model.version}`), ` is in force. ${LAST[model.action] ?? model.action} at ${number(model.time, 1)} s: ${model.text}`),
      model.on_trial ? el("p", { class: "tag warn" }, "△ on trial") : null,
      model.predicted ? table("Largest distance from the path", ["Joint", "Unit", "Predicted", "Measured"],
        faces.map((face, k) => [face.name, face.turns ? "mrad" : "mm", number(1000 * model.predicted[k], 2), model.measured ? number(1000 * model.measured[k], 2) : "–"]), { numeric: [2, 3], empty: "" }) : null,
    ] : el("p", {}, "There is no simulation service."));
    const now = store.state?.identification;
    progress.max = now?.of || 1;
    progress.value = Math.min(now?.samples ?? 0, progress.max);
    rebuild(said, now && [now.phase, now.text, now.doubts, now.fit], () => now ? [
      el("p", {}, el("strong", {}, now.phase), `: ${now.text}`),
      now.doubts ? el("p", { class: "tag warn" }, `△ in doubt: ${now.doubts}`) : null,
      now.fit ? el("p", {}, `Fit on held-out motion by joint: ${now.fit.map((value) => value.toFixed(3)).join(", ")}`) : null,
    ] : el("p", {}, "There is no identification service."));
    rebuild(parameters, now?.parameters, () => table("Estimates with 95 % intervals", ["Parameter", "Estimate", "± 95 %"],
      Object.entries(now?.parameters ?? {}).map(([key, found]) => [key, short(found.value, 5), short(NINETY_FIVE * found.standard_error, 2)]),
      { numeric: [1, 2], empty: "Nothing has been estimated: let the arm move for 30 s and identify it." }));
  }
  return { node, state };
}
