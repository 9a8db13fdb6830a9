// A command: greyed with the reason while it is not possible, confirmed where the arm moves or stops, answered in place.
import { el, setText } from "./dom.js";
import { post } from "./api.js";
import { store } from "./store.js";

/** Why a command cannot be given now, "" when it can. */
export function blocked(name) {
  if (store.past) return "not live: this is the past";
  if (!store.connected) return "no connection to the console";
  return store.you?.blocked[name] ?? "not known here";
}

/**
 * A button with its reason and its answer.
 * options: name of the command, title, confirm (question, or none), form (gives the content), done (called with the answer);
 * reason (why it cannot be given now) and send (gives it) are those of a command of the bus, if nothing else is said
 */
export function commandButton({
  name, title, confirm = null, form = () => ({}), done = () => {},
  reason = () => blocked(name), send = (content) => post(`/api/command/${name}`, content),
}) {
  const id = `why-${name}-${title.toLowerCase().replace(/[^a-z0-9]+/g, "-")}`;
  const why = el("span", { class: "why", id });
  const answer = el("span", { class: "answer", role: "status", hidden: true });
  const button = el("button", { type: "button", "aria-describedby": id, "data-command": name }, title);
  let busy = false;
  const show = (text, refused) => {
    answer.hidden = false;
    answer.classList.toggle("refused", refused);
    setText(answer, refused ? `✕ ${text}` : `✓ ${text}`);
  };
  button.addEventListener("click", async () => {
    if (busy || reason()) return;
    let content;
    try {
      content = form();
    } catch (error) {
      show(error.message, true);
      return;
    }
    if (confirm && !(await ask(title, typeof confirm === "function" ? confirm() : confirm))) return;
    busy = true;
    refresh();
    const result = await send(content);
    busy = false;
    refresh();
    show(result.text || (result.done ? "done" : "refused"), !result.done);
    done(result);
  });
  function refresh() {
    const words = busy ? "asked, waiting for the answer" : reason();
    button.setAttribute("aria-disabled", words ? "true" : "false");
    setText(why, words);
  }
  refresh();
  return { node: el("div", { class: "command" }, button, why, answer), refresh };
}

/** Asks for a confirmation in a dialog; Escape declines. */
export function ask(title, question) {
  return new Promise((resolve) => {
    const dialog = el("dialog", { "aria-labelledby": "ask-title" });
    const close = (answer) => {
      dialog.close();
      dialog.remove();
      resolve(answer);
    };
    dialog.append(
      el("h2", { id: "ask-title" }, title),
      el("p", {}, question),
      el("div", { class: "row" },
        el("button", { type: "button", "data-confirm": "yes", onclick: () => close(true) }, `Yes: ${title.toLowerCase()}`),
        el("button", { type: "button", onclick: () => close(false) }, "No")),
    );
    dialog.addEventListener("cancel", (event) => {
      event.preventDefault();
      close(false);
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
