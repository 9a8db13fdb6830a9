// Calculations that the server makes: started, watched, ended.
import { get, post } from "./api.js";
import { el, setText } from "./dom.js";

const LOOK = 300;

/** Has the server calculate, and returns {result} or {error}; told(number of the job, how far it is) is called now and then. */
export async function calculate(form, told = () => {}) {
  const begun = await post(`/api/job/${form.task}`, form);
  if (!begun.done) return { error: begun.text };
  for (;;) {
    let found;
    try {
      found = await get(`/api/job/${begun.job}`);
    } catch (error) {
      return { error: error.message };
    }
    if (found.over) return found;
    told(begun.job, found);
    await new Promise((resolve) => setTimeout(resolve, LOOK));
  }
}

/** A button that starts a calculation, with its progress; options: title, task (gives the form), done (gets the result). */
export function jobButton({ title, task, done }) {
  const button = el("button", { type: "button" }, title);
  const stop = el("button", { type: "button", hidden: true }, "End it");
  const bar = el("progress", { hidden: true, "aria-label": `${title}: progress` });
  const answer = el("span", { class: "answer", role: "status", hidden: true });
  let running = null;
  const say = (text, refused) => {
    answer.hidden = !text;
    answer.classList.toggle("refused", refused);
    setText(answer, refused ? `✕ ${text}` : text);
  };
  button.addEventListener("click", async () => {
    if (running) return;
    let form;
    try {
      form = task();
    } catch (error) {
      say(error.message, true);
      return;
    }
    running = "asked";
    button.setAttribute("aria-disabled", "true");
    bar.hidden = false;
    bar.removeAttribute("value");
    say("under way", false);
    const found = await calculate(form, (job, { done, of, best }) => {
      running = job;
      stop.hidden = false;
      if (!of) return;
      bar.max = of;
      bar.value = done;
      say(`${done} of ${of}${best == null ? "" : `, least cost ${best.toFixed(3)}`}`, false);
    });
    running = null;
    button.setAttribute("aria-disabled", "false");
    stop.hidden = bar.hidden = true;
    say(found.error || `${title}: done`, Boolean(found.error));
    if (found.result) done(found.result);
  });
  stop.addEventListener("click", () => running && post(`/api/job/${running}/end`));
  return el("div", { class: "command" }, el("span", { class: "row" }, button, stop), bar, answer);
}
