// What is abnormal now, and what has happened.
import { el, number, panel, rebuild, table } from "../dom.js";
import { store } from "../store.js";

export function makeAlarms() {
  const now = el("div");
  const events = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Events" });
  const node = el("div", { class: "grid" }, panel("Abnormal now", "w12", now), panel("Events", "w12", events));
  function state() {
    const shown = store.state;
    if (!shown) return;
    rebuild(now, shown.conditions, () => shown.conditions.length
      ? table("The gravest first", ["", "Kind", "What"], shown.conditions.map((one) => [el("span", { class: `tag ${one.severe ? "severe" : "warn"}` }, one.severe ? "▲ severe" : "△ notice"), one.kind, one.text]))
      : el("p", { class: "quiet" }, "Nothing is abnormal."));
    rebuild(events, shown.events, () => table("Newest first", ["s", "Kind", "What"], [...shown.events].reverse().map((event) => [number(event.time, 2), event.kind.replaceAll("_", " "), event.text]), [0]));
  }
  return { node, state };
}
