// Calculations that the server makes: started, watched, ended.
import { get, post } from "./api.js";
import { el, setText } from "./dom.js";

const LOOK = 300;

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
    const begun = await post(`/api/job/${form.task}`, form);
    if (!begun.done) {
      say(begun.text, true);
      return;
    }
    running = begun.job;
    button.setAttribute("aria-disabled", "true");
    stop.hidden = bar.hidden = false;
    bar.removeAttribute("value");
    say("under way", false);
    const found = await follow(begun.job);
    running = null;
    button.setAttribute("aria-disabled", "false");
    stop.hidden = bar.hidden = true;
    say(found.error || `${title}: done`, Boolean(found.error));
    if (found.result) done(found.result);
  });
  stop.addEventListener("click", () => running && post(`/api/job/${running}/end`));
  async function follow(number) {
    for (;;) {
      let found;
      try {
        found = await get(`/api/job/${number}`);
      } catch (error) {
        return { error: error.message };
      }
      if (found.of) {
        bar.max = found.of;
        bar.value = found.done;
        say(`${found.done} of ${found.of}${found.best == null ? "" : `, least cost ${found.best.toFixed(3)}`}`, false);
      }
      if (found.over) return found;
      await new Promise((resolve) => setTimeout(resolve, LOOK));
    }
  }
  return el("div", { class: "command" }, el("span", { class: "row" }, button, stop), bar, answer);
}
