// Level 2: what if it were controlled otherwise? Candidates side by side, search, upload on trial, history.
import { column, each, el, number, panel, rebuild, short, table } from "../dom.js";
import { get } from "../api.js";
import { commandButton } from "../command.js";
import { drawCurves } from "../curves.js";
import { choice, field, form, numberOf, triple } from "../fields.js";
import { jobButton } from "../jobs.js";
import { store } from "../store.js";
import { makeProposals } from "./proposals.js";
import { makeHistory, makeTrial } from "./trial.js";

const PLACES = ["pickup", "blue", "red", "green", "home", "hanging"].map((name) => [name, name]);
const MOST = 6;
const WAITING = "Simulate draws the candidates here.";

export function makeSimulation() {
  const start = choice("Start", PLACES, "pickup");
  const goal = choice("Goal", PLACES, "red");
  const payload = field("Payload, kg", { type: "number", step: "any", min: 0, max: 1 });
  const model = choice("Model of the controller", [["", "the one in force"]], "");
  const arm = choice("Simulated arm", [["", "the model in force"]], "");
  const target = field("Target time, s", { type: "number", step: "any", min: 0.1, max: 60 });
  const gains = { kp: triple("kp, 1/s²"), ki: triple("ki, 1/s³"), kd: triple("kd, 1/s") };
  const judged = field("Candidates to judge", { type: "number", step: 40, min: 80, max: 2000 }, "400");
  const why = field("Reason", { maxlength: 200, placeholder: "none given" });
  const candidates = el("div");
  let listed = [];
  let motions = [];
  let optimum = null;
  let filled = false;

  const settings = () => ({
    target_time: numberOf(target.input, "target time"),
    gains: Object.fromEntries(Object.entries(gains).map(([key, value]) => [key, value.get()])),
  });
  const fill = (wanted) => {
    target.input.value = short(wanted.target_time, 4);
    for (const [key, value] of Object.entries(gains)) value.set(wanted.gains[key].map((each) => Number(each.toPrecision(4))));
  };
  const add = el("button", { type: "button" }, "Add as a candidate");
  add.addEventListener("click", () => {
    if (listed.length >= MOST - 1) return;
    try {
      listed.push({ name: `candidate ${listed.length + 1}`, model: model.input.value || null, ...settings() });
    } catch (error) {
      add.setCustomValidity(error.message);
    }
    showCandidates();
  });
  const clear = el("button", { type: "button" }, "Forget the candidates");
  clear.addEventListener("click", () => { listed = []; showCandidates(); });
  const simulate = jobButton({
    title: "Simulate",
    task: () => ({
      task: "simulate", start: start.input.value, goal: goal.input.value, payload: numberOf(payload.input, "payload"), arm: arm.input.value || null,
      candidates: [...inForce(), ...(listed.length ? listed : [{ name: "the form", model: model.input.value || null, ...settings() }])],
    }),
    done: (result) => { motions = result.motions; showFigures(); draw(); },
  });
  /** What a search is judged against: what is in force, not what stands in the form. */
  const reference = () => {
    const [now] = inForce();
    if (!now) throw new Error("nobody knows what is in force: there is no simulation service");
    return { gains: now.gains, target_time: now.target_time };
  };
  const inForce = () => (store.live.state?.settings ? [{ name: "in force", gains: store.live.state.settings.gains, target_time: store.live.state.settings.target_time, model: null }] : []);
  const optimise = jobButton({
    title: "Optimise", task: () => ({ task: "optimise", ...reference(), candidates: numberOf(judged.input, "candidates"), arm: arm.input.value || null }),
    done: (result) => { optimum = result; showOptimum(); draw(); },
  });
  const upload = commandButton({
    name: "upload", title: "Upload gains and target time", confirm: "The settings go to the controller, on trial: the arm may move otherwise. They are taken back if it leaves its path.",
    form: () => ({ why: why.input.value || "no reason given", based_on: store.state?.settings?.version ?? 0, arm: arm.input.value || null, ...settings() }), done: () => history.load(),
  });
  const uploadModel = commandButton({
    name: "upload", title: "Upload the model", confirm: "The model goes to the controller, on trial: the arm may move otherwise.",
    form: () => {
      if (!model.input.value) throw new Error("choose a model that is not in force");
      return { why: why.input.value || "no reason given", based_on: store.state?.settings?.version ?? 0, model: model.input.value };
    },
    done: () => history.load(),
  });
  const trial = makeTrial();
  const proposals = makeProposals();
  const history = makeHistory();
  const figure = el("div", { tabindex: "0", role: "region", "aria-label": "Figures of the prediction" });
  const curves = [1, 2, 3].map((joint) => el("canvas", { class: "trend", role: "img", "aria-label": `Joint ${joint}: predicted distance from the path of every candidate` }));
  const volts = el("canvas", { class: "trend", role: "img", "aria-label": "Predicted voltages of joint 2 of every candidate, with their limits" });
  const front = el("canvas", { class: "front", role: "img", "aria-label": "Candidates of the search and their Pareto front" });
  const best = el("div");
  const buttons = [upload, uploadModel];
  const node = el(
    "div", { class: "grid filling footed" },
    panel("Settings to try", "w4", el("div", { class: "stack" }, form(start, goal, payload, arm, model, target, ...Object.values(gains)),
      el("div", { class: "row" }, add, clear), candidates, simulate)),
    panel("Predicted", "w4", figure, ...curves, volts),
    column("w4", panel("Upload", "", el("div", { class: "stack" }, form(why), el("div", { class: "row" }, upload.node, uploadModel.node), trial.node)),
      panel("Search", "grow", form(judged), optimise, front, best), panel("Proposals", "wide", proposals.node)),
    panel("History of the settings", "w12", history.node),
  );
  get("/api/models").then(({ models }) => {
    const offered = models.map((name) => [name, name]);
    model.offer([["", "the one in force"], ...offered]);
    arm.offer([["", "the model in force"], ...offered]);
  }).catch(() => {});
  history.load();

  function showCandidates() {
    rebuild(candidates, listed, () => listed.length ? table("Candidates beside what is in force", ["Name", "T, s", "kp", "ki", "kd"],
      listed.map((one) => [one.name, short(one.target_time), ...["kp", "ki", "kd"].map((key) => one.gains[key].map((value) => short(value, 4)).join(" "))]), { numeric: [1] }) : null);
  }
  function showFigures() {
    const rows = [
      ["Farthest from the path, mrad", (f) => each(f.tracking_max.map((v) => 1000 * v), 1)],
      ["Settled after, s", (f) => (f.settling_time == null ? "not settled" : number(f.settling_time, 2))],
      ["Error at the end, mrad", (f) => each(f.final_error.map((v) => 1000 * v), 2)],
      ["Peak voltage, V", (f) => each(f.peak_volts, 1)],
      ["At the voltage limit", (f) => `${(100 * f.saturated).toFixed(1)} %`],
      ["Energy, J", (f) => number(f.energy, 2)],
    ];
    rebuild(figure, motions.map((motion) => [motion.name, motion.figures]), () => motions.length
      ? table("What the twin predicts, with the real function blocks", ["", ...motions.map((motion) => motion.name)], rows.map(([name, of]) => [name, ...motions.map((motion) => of(motion.figures))]), { numeric: motions.map((_, k) => k + 1) })
      : null);
  }
  function showOptimum() {
    const take = el("button", { type: "button" }, "Take the best into the form");
    take.addEventListener("click", () => fill(optimum.best));
    rebuild(best, optimum, () => optimum.broken
      ? el("p", {}, `No candidate keeps all limits; the best breaks that of ${optimum.broken}.`)
      : [table(`Best of ${optimum.judged} candidates against the settings in force`, ["", "In force", "Found"], [
        ["Target time, s", number(optimum.reference.target_time), number(optimum.best.target_time)],
        ["Settling time, s", number(optimum.reference.terms.time), number(optimum.best.terms.time)],
        ["Farthest from the path, mrad", number(1000 * optimum.reference.terms.tracking, 1), number(1000 * optimum.best.terms.tracking, 1)],
        ["Cost", number(optimum.reference.cost), number(optimum.best.cost)],
      ], { numeric: [1, 2] }), take]);
  }

  function state() {
    buttons.forEach((button) => button.refresh());
    const now = store.state?.settings;
    if (now && !filled) {
      fill(now);
      payload.input.value = short(now.payload, 4);
      filled = true;
    }
    trial.state();
    proposals.state();
    history.state();
  }
  function draw() {
    curves.forEach((canvas, k) => drawCurves(canvas, {
      title: `Joint ${k + 1}: off the path`, unit: "mrad", across: "s",
      lines: motions.map((motion, dash) => ({ x: motion.time, y: motion.theta[k].map((value, i) => 1000 * (value - motion.path[k][i])), dash, name: motion.name })), empty: WAITING,
    }));
    drawCurves(volts, { title: "Joint 2: voltage and its limits", unit: "V", across: "s", levels: motions.length ? [-8, 8] : [], lines: motions.map((motion, dash) => ({ x: motion.time, y: motion.volts[1], dash, name: motion.name })), empty: WAITING });
    drawCurves(front, optimum && !optimum.broken ? {
      title: "Farthest from the path", unit: "mrad", across: "s to settle", points: optimum.points.map((point) => [point.time, 1000 * point.tracking]),
      lines: [{ x: optimum.front.map((point) => point.time), y: optimum.front.map((point) => 1000 * point.tracking), name: "Pareto front" }],
      marks: [{ x: optimum.reference.terms.time, y: 1000 * optimum.reference.terms.tracking, name: "in force" }, { x: optimum.best.terms.time, y: 1000 * optimum.best.terms.tracking, name: "best", filled: true }],
    } : { title: "Farthest from the path", unit: "mrad", across: "", empty: "Optimise draws what it has judged here." });
    trial.draw();
  }
  return { node, state, draw };
}
