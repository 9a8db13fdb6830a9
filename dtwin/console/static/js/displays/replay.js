// Any moment of the last hour, or of a recording, on the displays; nothing of it is live.
import { el, number, panel, setText } from "../dom.js";
import { get } from "../api.js";
import { choice } from "../fields.js";
import { calculate } from "../jobs.js";
import { pastOf, store } from "../store.js";

const STEP = 1;
const HOUR = "";
const BEYOND = 60;
const SAMPLE = 0.1;

export function makeReplay() {
  // What is looked at goes on while other displays are open; it is kept beside the past itself.
  let { source = HOUR, span = null, stretch = null } = store.past ?? {};
  let wanted = null;
  let busy = false;
  const slider = el("input", { type: "range", id: "moment", step: SAMPLE });
  const words = el("p", { role: "status" });
  const log = choice("Recording", [["", "none"]], "");
  const button = (title, act) => el("button", { type: "button", onclick: act }, title);
  const node = el(
    "div", { class: "grid" },
    panel("Look back", "w12",
      el("p", {}, "Choose a moment; then open any display. Everything on it is of that moment, and no command can be given."),
      el("div", { class: "row" },
        button("Look at the last hour", () => begin(HOUR)), button("◀ 1 s", () => step(-STEP)), button("1 s ▶", () => step(STEP)),
        button("Back to the present", () => { store.show(null); say(); })),
      el("label", { for: "moment" }, "Moment"), slider, words),
    panel("Recordings", "w12", el("div", { class: "row" }, log.label, log.input,
      button("Look at the recording", () => (log.input.value ? begin(log.input.value) : setText(words, "✕ choose a recording"))))),
  );
  slider.addEventListener("input", () => seek(Number(slider.value)));
  get("/api/logs").then(({ logs: found }) => log.offer([["", found.length ? "choose one" : "there is none"], ...found.map((name) => [name, name])])).catch(() => {});
  place();
  say();

  function begin(chosen) {
    source = chosen;
    span = stretch = null;
    seek(null);
  }
  function step(by) {
    if (!span) return;
    slider.value = Number(slider.value) + by;
    seek(Number(slider.value));
  }
  /** Shows a moment, the newest when it is null; of several that are asked for at once the last. */
  async function seek(at) {
    wanted = { at };
    if (busy) return;
    busy = true;
    let now;
    do {
      now = wanted;
      await show(now.at);
    } while (now !== wanted);
    busy = false;
  }
  async function show(at) {
    const asked = source;
    try {
      const found = asked === HOUR ? await get(`/api/past${at == null ? "" : `?at=${at}`}`) : await partOf(asked, at);
      if (asked !== source) return;
      if (!found.span) throw new Error("nothing has been kept yet");
      ({ span } = found);
      const past = pastOf(found);
      if (!past.frame) throw new Error("nothing was heard at that moment");
      store.show({ ...past, source, span, stretch });
      place(at);
      say();
    } catch (error) {
      setText(words, `✕ ${error.message}`);
    }
  }
  /** What a recording holds up to a moment; a stretch of it is read at a time, beyond the moment, too. */
  async function partOf(name, at) {
    const time = (row) => row[stretch.columns.indexOf("at")];
    if (!stretch || at == null || at < time(stretch.rows[0]) - SAMPLE || at > time(stretch.rows.at(-1)) + SAMPLE) {
      setText(words, `Reads ${name} ...`);
      const found = await calculate({ task: "recall", log: name, at: at == null ? null : at + BEYOND });
      if (!found.result) throw new Error(found.error);
      stretch = found.result;
    }
    const end = (at ?? time(stretch.rows.at(-1))) + SAMPLE / 10;
    const events = stretch.state.events.filter((event) => event.time <= end);
    return { ...stretch, rows: stretch.rows.filter((row) => time(row) <= end), state: { ...stretch.state, events } };
  }
  function place(at = null) {
    [slider.min, slider.max] = span ?? [0, 1];
    if (at === null) slider.value = store.past?.frame?.at ?? 1;
  }
  function say() {
    const frame = store.past?.frame;
    const where = source === HOUR ? `${new Date(1000 * frame?.at).toLocaleTimeString()}` : source;
    setText(words, frame ? `Not live: ${where}, plant time ${number(frame.time, 2)} s` : "The present is shown.");
    slider.setAttribute("aria-valuetext", words.textContent);
  }
  return { node };
}
