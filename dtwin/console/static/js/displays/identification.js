// Level 2: what is the arm? Excited, fitted, shown against the model before, kept or not.
import { column, el, panel, rebuild, short, table } from "../dom.js";
import { commandButton } from "../command.js";
import { drawCurves } from "../curves.js";
import { field, form, numberOf } from "../fields.js";
import { jobButton } from "../jobs.js";
import { store } from "../store.js";

const NINETY_FIVE = 1.96;
const REFITTED = /^(K|D|mu)[123]$/;
const VECTOR = { K: "voltage_constant", m: "mass", I: "inertia", l: "length", c: "com", D: "damping", mu: "coulomb" };

export function makeIdentification() {
  const free = field("Free parameters", { maxlength: 200 }, "K2,K3,I,c,D");
  const box = field("Mass of a held box, kg", { type: "number", step: "any", min: 0, max: 1, placeholder: "as the cell's" }, "");
  const name = field("Name of the model", { maxlength: 32, pattern: "[A-Za-z0-9_.-]+" }, "arm");
  const upload = el("input", { type: "checkbox", id: "with-upload" });
  const anyway = el("input", { type: "checkbox", id: "anyway" });
  const start = commandButton({
    name: "identify", title: "Excite and identify", confirm: "The blocks play the 3-2-1-1 signal: the arm leaves its work and swings for 3.5 s.",
    form: () => ({ free: free.input.value, box_mass: box.input.value === "" ? null : numberOf(box.input, "mass") }),
  });
  const atWork = {
    free: field("Free parameters of the arm at work", { maxlength: 200 }, "D"),
    anew: field("Of these not known any more", { maxlength: 200 }, ""),
    since: field("Motion counts since, s", { type: "number", step: "any", min: 0 }, "0"),
  };
  const refit = commandButton({
    name: "identify", title: "Identify at work",
    form: () => ({ source: "motion", free: atWork.free.input.value, anew: atWork.anew.input.value, since: numberOf(atWork.since.input, "since") }),
  });
  let filled = "";
  const accept = commandButton({
    name: "accept", title: "Accept the model", confirm: () => (upload.checked ? "The model is kept and goes to the controller, on trial: the arm may move otherwise." : `The model is kept as ${name.input.value}.`),
    form: () => ({ name: name.input.value, upload: upload.checked, anyway: anyway.checked }),
  });
  const reject = commandButton({ name: "reject", title: "Reject the model" });
  const buttons = [start, refit, accept, reject];
  const progress = el("progress", { "aria-label": "Samples of the signal", max: 1, value: 0 });
  const said = el("div", { role: "status" });
  const parameters = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Parameters" });
  const canvases = [1, 2, 3].map((joint) => el("canvas", { class: "trend", role: "img", "aria-label": `Joint ${joint}: measured, model before, proposed model` }));
  const fits = el("p", { class: "quiet" });
  let compared = null;
  const compare = jobButton({
    title: "Show the models against the motion", task: () => ({ task: "compare" }),
    done: (result) => { compared = result; draw(); },
  });
  const node = el(
    "div", { class: "grid filling" },
    column("w4", panel("Identify", "", el("div", { class: "stack" }, form(free, box), start.node,
      el("h3", {}, "What has changed, from the motions at work"), form(...Object.values(atWork)), refit.node, progress)),
    panel("Decide", "grow", el("div", { class: "stack" }, form(name),
      el("span", {}, upload, " ", el("label", { for: "with-upload" }, "upload it to the controller, on trial")),
      el("span", {}, anyway, " ", el("label", { for: "anyway" }, "keep it even if it is in doubt")),
      el("div", { class: "row" }, accept.node, reject.node)))),
    column("w8", panel("Parameters", "grow", said, parameters), panel("Fit of the models to the motion", "grow", compare, fits, ...canvases)),
  );

  /** Proposes what the findings name, since they were noticed. */
  function propose() {
    const found = Object.values(store.state?.verdict?.units ?? {}).filter((unit) => unit.settled && REFITTED.test(unit.parameter));
    const names = found.map((unit) => unit.parameter).join(",");
    if (!names || names === filled) return;
    filled = names;
    atWork.free.input.value = [...new Set(found.map((unit) => unit.parameter.replace(/\d/, "")))].join(",");
    atWork.anew.input.value = names;
    atWork.since.input.value = Math.min(...found.map((unit) => unit.detected)).toFixed(2);
  }

  function state() {
    propose();
    buttons.forEach((button) => button.refresh());
    const now = store.state?.identification;
    progress.max = now?.of || 1;
    progress.value = Math.min(now?.samples ?? 0, progress.max);
    rebuild(said, now && [now.phase, now.text, now.doubts, now.fit], () => now ? [
      el("p", {}, el("strong", {}, now.phase), `: ${now.text}`),
      now.doubts ? el("p", { class: "tag warn" }, `△ in doubt: ${now.doubts}`) : null,
      now.fit ? el("p", {}, `Fit on held-out motion, joints 1 to 3: ${now.fit.map((value) => value.toFixed(4)).join(", ")}`) : null,
      now.phase === "proposed" ? el("p", {}, `${now.converged ? "The search converged" : "The search did not converge"}; residuals ${now.residual_white ? "white" : "not white"}; rank ${now.rank}.`) : null,
    ] : el("p", {}, "There is no identification service."));
    const model = store.state?.settings?.model;
    rebuild(parameters, [now?.parameters, model], () => table("Estimates with 95 % intervals, against the model in the controller", ["Parameter", "Estimate", "± 95 %", "Before", "Change"],
      Object.entries(now?.parameters ?? {}).map(([key, found]) => {
        const before = valueOf(model, key);
        const change = before ? (100 * (found.value - before)) / before : null;
        return [key, short(found.value, 5), short(NINETY_FIVE * found.standard_error, 2), before == null ? "–" : short(before, 5), change == null ? "–" : `${change.toFixed(1)} %`];
      }), { numeric: [1, 2, 3, 4], empty: "Nothing has been estimated: excite the arm, or identify it at work." }));
  }

  function draw() {
    fits.textContent = compared ? `Fit of the model before: ${words(compared.before_fit)}; of the proposed one: ${words(compared.proposed_fit)}` : "Available after an excitation that this console has heard.";
    canvases.forEach((canvas, k) => {
      const x = compared ? compared.measured[k].map((_, index) => index / 100) : [];
      drawCurves(canvas, {
        title: `Joint ${k + 1}`, unit: "rad", across: "s",
        empty: "Drawn when the models are shown against the motion.",
        lines: compared ? ["measured", "before", "proposed"].map((key, dash) => ({ x, y: compared[key][k], dash, name: key, wide: dash === 0 })) : [],
      });
    });
  }
  return { node, state, draw };
}

const words = (fit) => fit.map((value) => value.toFixed(4)).join(", ");

export function valueOf(model, name) {
  const [, symbol, joint] = /^([a-zA-Z]+)([123])$/.exec(name) ?? [];
  return model?.[VECTOR[symbol]]?.[joint - 1] ?? null;
}
