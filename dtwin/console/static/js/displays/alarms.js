// Alarms by ISA-18.2 / IEC 62682: what has to be answered, the shelf, what design suppresses, and the history.
import { el, number, panel, rebuild, setText, table } from "../dom.js";
import { get, post } from "../api.js";
import { ask } from "../command.js";
import { field, form } from "../fields.js";
import { store } from "../store.js";

const SHAPES = { high: "▲", medium: "△", low: "▿" };
const DONE = { acknowledge: "acknowledged", shelve: "shelved", unshelve: "taken off the shelf" };
const HIDDEN = ["shelved", "suppressed by design"];

export function makeAlarms() {
  const now = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Alarms" });
  const rate = el("p", { role: "status" });
  const answer = el("p", { class: "answer", role: "status", hidden: true });
  const why = field("Reason for the shelf", { maxlength: 200 }, "");
  const minutes = field("Time on the shelf, min", { type: "number", min: 1, max: 480 }, "15");
  const words = field("Words to look for", { maxlength: 200 }, "");
  const history = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "History of the alarms" });
  const events = el("div", { class: "scroll short", tabindex: "0", role: "region", "aria-label": "Events" });
  const download = el("a", { href: "/api/alarms.csv", download: "alarms.csv" }, "Save as CSV");
  words.input.addEventListener("input", () => {
    download.href = `/api/alarms.csv?words=${encodeURIComponent(words.input.value)}`;
    load();
  });
  const node = el(
    "div", { class: "grid filling thirds" },
    panel("Alarms", "w12", rate, now, answer, el("div", { class: "row" }, form(why), form(minutes))),
    panel("History", "w12", el("div", { class: "row" }, form(words), download), history),
    panel("Events", "w12", events),
  );
  load();

  async function load() {
    const found = await get(`/api/alarms?words=${encodeURIComponent(words.input.value)}`).catch(() => null);
    if (found) rebuild(history, found.rows, () => table("Newest first; times are UTC", found.columns, found.rows.map((row) => row.map((cell, k) => found.columns[k] === "time" ? cell.slice(0, 19).replace("T", " ") : cell)),
      { empty: words.input.value ? "No change of an alarm has all these words." : "No alarm has come yet." }));
  }
  async function treat(action, name) {
    if (action === "shelve" && !(await ask("Shelve the alarm", `${name} is hidden for ${minutes.input.value} minutes.`))) return;
    const result = await post(`/api/alarm/${action}`, { name, why: why.input.value, minutes: Number(minutes.input.value) || 15 });
    answer.hidden = false;
    answer.classList.toggle("refused", !result.done);
    setText(answer, result.done ? `✓ ${DONE[action]}: ${name}` : `✕ ${result.text}`);
    load();
  }
  const button = (title, action, name) => el("button", { type: "button", "aria-label": `${title} ${name}`, onclick: () => treat(action, name) }, title);
  const row = (one) => [
    one.state, el("span", { class: `tag ${one.priority === "high" ? "severe" : "warn"}` }, `${SHAPES[one.priority]} ${one.priority}`),
    `${one.first_out ? "① first out: " : ""}${one.text}${one.suppressed ? ` (${one.suppressed})` : ""}`, one.response, number(one.plant, 1), String(one.count),
    el("span", { class: "row" },
      one.unacknowledged && !HIDDEN.includes(one.state) ? button("Acknowledge", "acknowledge", one.name) : null,
      HIDDEN.includes(one.state) ? null : button("Shelve", "shelve", one.name),
      one.state === "shelved" ? button("Unshelve", "unshelve", one.name) : null),
  ];
  function state() {
    const alarms = store.past ? null : store.alarms;
    setText(rate, store.past ? "The alarms of the past are in the history."
      : `${alarms?.rate ?? 0} alarms in the last 10 minutes${alarms?.flood ? ": ▲ a flood" : ""}${alarms?.floods ? `; floods in the history: ${alarms.floods}` : ""}${alarms?.trouble ? `; the journal is not written: ${alarms.trouble}` : ""}`);
    const key = alarms?.alarms ?? [];
    if (now.madeOf !== JSON.stringify(key)) load();
    rebuild(now, key, () => table("Unacknowledged first, then by priority", ["State", "Priority", "Alarm", "What to do", "Plant time, s", "Times", "Answer"], key.map(row),
      { numeric: [4, 5], empty: store.past ? "Only the present has alarms that stand." : "No alarm stands." }));
    const shown = store.state;
    rebuild(events, shown?.events, () => table("Newest first", ["s", "Kind", "What"], [...(shown?.events ?? [])].reverse().map((event) => [number(event.time, 2), event.kind.replaceAll("_", " "), event.text]),
      { numeric: [0], empty: "Nothing has happened since the console listens." }));
  }
  return { node, state };
}
