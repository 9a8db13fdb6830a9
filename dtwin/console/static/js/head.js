// The head of every display: cell, whether it is live, the desk, the theme; and the line of what is abnormal.
import { el, rebuild, setText } from "./dom.js";
import { post } from "./api.js";
import { makeStop } from "./stop.js";
import { store } from "./store.js";
import { forgetPalette } from "./canvas.js";

const THEMES = ["light", "dark"];
// Length of a condition that is not cut off in the line of what is abnormal.
const BRIEF = 45;

export function makeHead(node) {
  const title = el("h1", {}, "Cell console");
  const live = el("span", { class: "tag", id: "live", role: "status" });
  const doing = el("span", { id: "doing", class: "grow" });
  const desk = el("span", { id: "desk" });
  const answer = el("span", { role: "status" });
  const occupy = el("button", { type: "button", id: "occupy" });
  occupy.addEventListener("click", async () => {
    const result = await post(`/api/desk/${store.you?.yours ? "leave" : "occupy"}`);
    const unnoted = result.text.includes("not noted");
    setText(answer, result.done ? (unnoted ? result.text : "") : `✕ ${result.text}`);
  });
  const theme = el("button", { type: "button", id: "theme" });
  theme.addEventListener("click", () => setTheme(THEMES[1 - THEMES.indexOf(document.documentElement.dataset.theme)]));
  const logout = el("button", { type: "button", hidden: true }, "Log out");
  logout.addEventListener("click", async () => {
    await post("/api/logout");
    location.assign("/login");
  });
  const stop = makeStop();
  node.replaceChildren(title, live, doing, ...stop.nodes, desk, occupy, answer, theme, logout);

  function setTheme(name) {
    document.documentElement.dataset.theme = name;
    localStorage.setItem("theme", name);
    setText(theme, name === "dark" ? "Light" : "Dark");
    theme.setAttribute("aria-label", `Change to the ${name === "dark" ? "light" : "dark"} theme`);
    forgetPalette();
    store.tell("frame");
  }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  setTheme(localStorage.getItem("theme") ?? (dark ? "dark" : "light"));

  return function refresh() {
    const state = store.state;
    setText(title, !state ? "Cell console" : state.line ? `Line ${state.cell}` : `${state.cell} / ${state.arm}`);
    document.title = state ? `${state.cell}: console` : "Cell console";
    for (const each of stop.nodes) each.hidden = Boolean(state?.line);
    const [words, kind] = liveness();
    setText(live, words);
    live.className = `tag ${kind}`;
    setText(doing, state ? state.doing.charAt(0).toUpperCase() + state.doing.slice(1) : "");
    stop.refresh();
    const you = store.you;
    setText(desk, you ? `${state?.line ? desksOf(state.line, you) : `Desk: ${you.yours ? "yours" : you.desk || "free"}`}; ${you.user}, ${you.role}` : "");
    if (state?.line) setText(occupy, you?.yours ? "Leave my desks" : "Take all desks");
    else setText(occupy, you?.yours ? "Leave the desk" : "Occupy the desk");
    logout.hidden = !store.session?.login;
  };
}

/** Who has the desks of a line's zones. */
function desksOf({ desks }, you) {
  if (you.zones.length === desks.length && desks.length) return "Desks: all yours";
  const had = desks.filter(({ user }) => user).map(({ zone, user }) => `${zone} ${you.zones.includes(zone) ? "yours" : user}`);
  return `Desks: ${had.slice(0, 4).join(", ") || "free"}${had.length > 4 ? " and more" : ""}`;
}

function liveness() {
  if (store.past) return ["◷ not live: the past", "warn"];
  if (!store.connected) return ["✕ no connection to the console", "severe"];
  if (store.stale) return [`▲ stale: ${Number.isFinite(store.age) ? `last ${store.state?.line ? "word" : "sample"} ${store.age.toFixed(0)} s ago` : "no sample yet"}`, "severe"];
  return ["● live", ""];
}

export function refreshAlarmLine(node) {
  const found = store.connected || store.past ? (store.state?.conditions ?? []) : [{ text: "the page has lost the console; it comes back by itself", severe: true, key: "lost" }];
  const alarms = store.past ? null : store.alarms;
  const open = alarms?.alarms.filter((one) => one.unacknowledged && !one.suppressed && one.shelved_until == null).length ?? 0;
  const count = () => el("a", { href: "#alarms" }, `${open} unacknowledged${alarms?.flood ? `, flood: ${alarms.rate} in 10 minutes` : ""}`);
  rebuild(node, [found, open, alarms?.flood && alarms.rate], () => (open ? [count()] : []).concat(
    found.length
      ? found.slice(0, 4).map((each) => el("span", { class: `tag ${each.severe ? "severe" : "warn"}${each.text.length < BRIEF ? " brief" : ""}` }, `${each.severe ? "▲" : "△"} ${each.text}`))
        .concat(found.length > 4 ? [el("span", {}, `and ${found.length - 4} more`)] : [])
      : [el("span", { class: "quiet" }, "nothing abnormal")]));
}
