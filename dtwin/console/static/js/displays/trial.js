// The trial of an upload, predicted against measured, and the history of all settings.
import { el, each, number, rebuild, short, table } from "../dom.js";
import { get } from "../api.js";
import { commandButton } from "../command.js";
import { drawTrend } from "../trend.js";
import { store } from "../store.js";

const LEAST = 10;
const FACTOR = 1.5;
const ALLOWANCE = 10;
const LAST = { start: "Found in force", upload: "Uploaded", refuse: "Another one was refused", confirm: "Confirmed", "roll back": "Rolled back" };

export function makeTrial() {
  const rollback = commandButton({ name: "rollback", title: "Roll back", confirm: "The settings before those on trial are in force again at once: the arm may move otherwise." });
  const words = el("div", { role: "status" });
  const trend = el("canvas", { class: "trend", role: "img", "aria-label": "Largest distance of a joint from its path, with the bounds of the trial" });
  let seen = 0;
  let peak = [0, 0, 0];
  const node = el("div", { class: "stack" }, words, trend, rollback.node);

  function state() {
    rollback.refresh();
    const now = store.state?.settings;
    if (now?.version !== seen) {
      seen = now?.version;
      peak = [0, 0, 0];
    }
    const time = store.frame?.time ?? 0;
    const left = now?.on_trial ? Math.max(0, Math.ceil(LEAST - (time - now.time))) : null;
    rebuild(words, now && [now.version, now.action, now.text, left, now.on_trial, now.on_trial ? Math.floor(time) : 0], () => now ? [
      el("p", {}, el("strong", {}, `Version ${now.version}`), ` is in force. ${LAST[now.action] ?? now.action} at ${number(now.time, 1)} s: ${now.text}`),
      now.on_trial
        ? el("p", { class: "tag warn" }, left ? `△ on trial, at least ${left} s more` : "△ on trial, until a whole motion is judged")
        : null,
      now.predicted ? el("p", {}, `Predicted at most ${each(now.predicted.map((v) => 1000 * v), 1)} mrad; measured since the page looks on ${each(peak, 1)} mrad`) : null,
    ] : el("p", {}, "There is no simulation service."));
  }
  function draw() {
    const frame = store.frame;
    if (frame?.theta && frame.path) peak = peak.map((value, k) => Math.max(value, 1000 * Math.abs(frame.theta[k] - frame.path[k])));
    const predicted = store.state?.settings?.predicted;
    const bound = predicted ? FACTOR * 1000 * Math.max(...predicted) + ALLOWANCE : NaN;
    drawTrend(trend, store.trends, {
      title: "Measured distance from the path, joints 1 —, 2 – –, 3 · ·", unit: "mrad", range: [0, Number.isFinite(bound) ? 1.3 * bound : 60],
      lines: [1, 2, 3].map((joint, dash) => ({ of: (v) => 1000 * Math.abs(v(`theta_${joint}`) - v(`path_${joint}`)), dash })),
      levels: [{ value: bound, name: "bound of the trial" }],
    });
  }
  return { node, state, draw };
}

export function makeHistory() {
  const list = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "History of the settings" });
  let known = "";
  let entries = [];
  const buttons = new Map();
  async function load() {
    try {
      ({ entries } = await get("/api/history"));
    } catch {
      entries = [];
    }
    show();
  }
  function show() {
    rebuild(list, entries, () => {
      buttons.clear();
      return table("Newest first", ["Version", "s", "What", "Who", "Why", "Changed", "Answer", ""], [...entries].reverse().map((entry) => [
        String(entry.version), number(entry.time, 1), `${entry.action} ${entry.kind}`, entry.who, entry.why,
        entry.changed.slice(0, 8).map(([name, before, after]) => `${name} ${short(before, 4)} → ${short(after, 4)}`).join("; ") + (entry.changed.length > 8 ? "; ..." : ""),
        entry.text, entry.action === "upload" || entry.action === "start" ? again(entry.version) : "",
      ]), { numeric: [0, 1], empty: store.state?.settings ? "No change has been noted." : "Nobody notes the settings: there is no simulation service." });
    });
    state();
  }
  function again(version) {
    const button = commandButton({
      name: "upload", title: `Upload version ${version} again`, confirm: `The settings of version ${version} go to the controller, on trial.`,
      form: () => ({ why: `version ${version} again`, based_on: store.state?.settings?.version ?? 0, version }), done: load,
    });
    buttons.set(version, button);
    return button.node;
  }
  function state() {
    for (const button of buttons.values()) button.refresh();
    const now = store.live.state?.settings;
    const key = JSON.stringify([now?.version, now?.action, now?.time]);
    if (now && key !== known) {
      known = key;
      load();
    }
  }
  return { node: list, load, state };
}
