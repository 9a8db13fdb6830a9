// Any moment of the last hour, or of a recording, on the displays; nothing of it is live.
import { el, number, panel, setText } from "../dom.js";
import { get } from "../api.js";
import { choice } from "../fields.js";
import { jobButton } from "../jobs.js";
import { pastOf, store } from "../store.js";

const STEP = 1;

export function makeReplay() {
  const slider = el("input", { type: "range", id: "moment", min: 0, max: 1, step: 0.1, value: 1 });
  const words = el("p", { role: "status" }, "The present is shown.");
  const log = choice("Recording", [["", "none"]], "");
  const logs = el("div", { class: "row" });
  let source = "hour";
  let span = null;
  let asked = 0;

  const live = el("button", { type: "button" }, "Back to the present");
  live.addEventListener("click", () => {
    store.show(null);
    setText(words, "The present is shown.");
  });
  const hour = el("button", { type: "button" }, "Look at the last hour");
  hour.addEventListener("click", () => {
    source = "hour";
    load(null);
  });
  const recall = jobButton({
    title: "Look at the recording", task: () => {
      if (!log.input.value) throw new Error("choose a recording");
      return { task: "recall", log: log.input.value, at: source === log.input.value && span ? Number(slider.value) : null };
    },
    done: (result) => { source = log.input.value; take(result); },
  });
  const step = (by) => {
    slider.value = Number(slider.value) + by;
    slider.dispatchEvent(new Event("input"));
  };
  const back = el("button", { type: "button" }, "◀ 1 s");
  back.addEventListener("click", () => step(-STEP));
  const on = el("button", { type: "button" }, "1 s ▶");
  on.addEventListener("click", () => step(STEP));
  slider.addEventListener("input", () => {
    if (source === "hour") load(Number(slider.value));
    else setText(words, `${number(Number(slider.value), 1)} s of ${source}: press "Look at the recording"`);
  });
  logs.append(log.label, log.input, recall);
  const node = el(
    "div", { class: "grid" },
    panel("Look back", "w12",
      el("p", {}, "Choose a moment; then open any display. Everything on it is of that moment, and no command can be given."),
      el("div", { class: "row" }, hour, back, on, live),
      el("label", { for: "moment" }, "Moment"), slider, words),
    panel("Recordings", "w12", logs),
  );
  get("/api/logs").then(({ logs: found }) => log.offer([["", found.length ? "choose one" : "there is none"], ...found.map((name) => [name, name])])).catch(() => {});
  if (store.past) setText(words, "The past is shown.");

  async function load(at) {
    const number = (asked += 1);
    const found = await get(`/api/past${at == null ? "" : `?at=${at}`}`).catch(() => null);
    if (number === asked && found?.span) take(found);
    else if (!found?.span) setText(words, "Nothing has been kept yet.");
  }
  function take(found) {
    const past = pastOf(found);
    const first = span === null || span[0] !== found.span[0];
    span = found.span;
    slider.min = span[0];
    slider.max = span[1];
    if (!past.frame) {
      setText(words, "Nothing was heard at that moment.");
      return;
    }
    if (first || source !== "hour") slider.value = past.frame.at;
    store.show(past);
    const when = source === "hour" ? `${new Date(1000 * past.frame.at).toLocaleTimeString()}, ` : "";
    setText(words, `Not live: ${when}plant time ${number(past.frame.time, 2)} s`);
    slider.setAttribute("aria-valuetext", words.textContent);
  }
  return { node };
}
