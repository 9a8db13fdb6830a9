// The stop of the arm, which everybody who may stop has on every display, with or without the desk, also while the past is shown.
import { el, setText } from "./dom.js";
import { post } from "./api.js";
import { store } from "./store.js";

// Time in which the second click must follow, ms.
const PATIENCE = 20000;
const STOP = "Stop the arm";
const AGAIN = "Stop: click again";

export function makeStop() {
  const answer = el("span", { class: "answer", role: "status", id: "stop-answer" });
  const button = el("button", { type: "button", id: "stop", "data-command": "stop", "aria-describedby": "stop-answer" }, STOP);
  let timer = 0;
  const arm = (armed) => {
    clearTimeout(timer);
    timer = armed ? setTimeout(() => arm(false), PATIENCE) : 0;
    button.classList.toggle("armed", armed);
    setText(button, armed ? AGAIN : STOP);
  };
  const show = (text, refused) => {
    answer.classList.toggle("refused", refused);
    setText(answer, refused ? `✕ ${text}` : `✓ ${text}`);
  };
  button.addEventListener("keydown", (event) => {
    if (event.key === "Escape") arm(false);
  });
  button.addEventListener("blur", () => arm(false));
  button.addEventListener("click", async () => {
    const reason = store.you?.blocked.stop;
    if (reason) {
      show(reason, true);
      return;
    }
    if (!timer) {
      arm(true);
      return;
    }
    arm(false);
    setText(answer, "asked, waiting for the answer");
    // Whether a connection is thought to be there does not matter: a stop is always tried.
    const result = await post("/api/command/stop", { why: "from the console" });
    show(result.text || (result.done ? "done" : "refused"), !result.done);
  });
  const refresh = () => button.setAttribute("aria-disabled", store.you?.blocked.stop ? "true" : "false");
  return { nodes: [button, answer], refresh };
}
