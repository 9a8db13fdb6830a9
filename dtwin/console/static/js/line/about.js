// What displays of a line share: who may do what from which desk, names in words, small drawings.
import { blocked, commandButton } from "../command.js";
import { post } from "../api.js";
import { el, number, rebuild } from "../dom.js";
import { store } from "../store.js";

/** The line as it was last told, and as it was built; null before. */
export const told = () => store.state?.line?.state ?? null;
export const plan = () => store.state?.line?.plan ?? null;

/** Whether nothing was heard of the twin of the line since the console began: what it keeps is not known. */
export const twinUnheard = () => told()?.twins === "silent";

/** Why the desks of some zones are not those of this session, "" when they are. */
export function deskReason(zones) {
  const desks = store.state?.line?.desks ?? [];
  if (!desks.length) return "the line does not answer, which keeps the desks";
  const missing = desks.find(({ zone }) => zones.includes(zone) && !store.you?.zones.includes(zone));
  if (!missing) return zones.length || store.you?.zones.length ? "" : "take the desk of a zone first";
  return missing.user ? `${missing.user} has the desk of zone ${missing.zone}` : `take the desk of zone ${missing.zone} first`;
}

/** The zones that a set-up concerns: of the stations that get operations, and that give them away. */
export function zonesOf(changes) {
  const line = told();
  const zone = (name) => line?.stations.find((station) => station.name === name)?.zone;
  const found = Object.entries(changes).filter(([name, at]) => line?.set_up[name] !== at).flatMap(([name, at]) => [zone(at), zone(line?.set_up[name])]);
  return [...new Set(found)].filter(Boolean);
}

/** What the twin of a zone expects of the set-up in force; null where a station of the line cannot do its part. */
export function expectedOf(zone) {
  const expected = store.state?.line?.expected;
  return expected?.rate_now ? expected.zones.find((each) => each.zone === zone) ?? null : null;
}

/** Who has the desk of a zone, and the button that takes or leaves it. */
export function makeDesk(zone) {
  const who = el("span");
  const answer = el("span", { class: "answer refused", role: "status", hidden: true });
  const button = el("button", { type: "button", "data-desk": zone });
  const mine = () => Boolean(store.you?.zones.includes(zone));
  button.addEventListener("click", async () => {
    const result = await post(`/api/desk/${mine() ? "leave" : "occupy"}?zone=${encodeURIComponent(zone)}`);
    answer.hidden = result.done;
    answer.textContent = result.done ? "" : `✕ ${result.text}`;
  });
  function refresh() {
    const desk = store.state?.line?.desks.find((each) => each.zone === zone);
    rebuild(who, [desk?.user, mine()], () => document.createTextNode(`Desk: ${mine() ? "yours" : desk?.user || (desk ? "free" : "not known")}`));
    button.textContent = mine() ? `Leave desk ${zone}` : `Take desk ${zone}`;
  }
  return { node: el("span", { class: "row" }, who, button, answer), refresh };
}

/** Stop and release of a station's arm, of which the one is shown that is possible. */
export function stationButtons(name, zone) {
  const station = () => told()?.stations.find((each) => each.name === name);
  /** Whether it is stopped, or works with other settings than those of its cell: a person ends both. */
  const changed = () => station()?.doing === "stopped" || Boolean(station()?.settings);
  const stop = commandButton({
    name: "stop", title: `Stop ${name}`, confirm: `The arm of ${name} stops where it is and keeps its box. This is no emergency stop.`,
    form: () => ({ station: name }), reason: () => blocked("stop") || (station()?.doing === "stopped" ? "its arm is stopped" : ""),
  });
  const release = commandButton({
    name: "release", title: `Release ${name}`, confirm: `The arm of ${name} moves again, as one that is repaired; its work comes back.`,
    form: () => ({ station: name }),
    reason: () => (changed() ? blocked("release") || deskReason([zone]) : "its arm is not stopped"),
  });
  const refresh = () => {
    stop.refresh();
    release.refresh();
    const stopped = station()?.doing === "stopped";
    stop.node.hidden = stopped;
    release.node.hidden = !changed();
  };
  refresh();
  return { nodes: [stop.node, release.node], refresh };
}
export const several = (count, word, words) => `${count} ${count === 1 ? word : words}`;

const DOING = { works: "works", waits: "waits", blocked: "△ blocked", stopped: "▲ stopped" };
/** What a station does: grey unless it is abnormal. */
export function doing(station) {
  const words = DOING[station.doing] ?? station.doing;
  if (station.doing === "stopped") return el("span", { class: "tag severe" }, words);
  return station.doing === "blocked" ? el("span", { class: "tag" }, words.slice(2)) : words;
}
/** What its arm can still do. */
export const ability = (station) => (station.ability === "all" ? "all" : el("span", { class: "tag warn" }, `△ ${station.ability}`));
export const box = (count) => (count ? `${count}` : "–");
export const operationsOf = (name) => Object.entries(told()?.set_up ?? {}).filter(([, at]) => at === name).map(([operation]) => operation);
export const percent = (share) => `${Math.round(100 * share)} %`;
export const oee = ({ availability, performance, quality }) => availability * performance * quality;

/** A bar on a scale from 0 to a full value, with marks; words beside it say the same. */
export function drawBar(context, colours, { x, y, width, height }, { value, full, mark = null, bad = false }) {
  const at = (amount) => x + Math.max(0, Math.min(1, amount / full)) * width;
  context.fillStyle = colours.panel;
  context.fillRect(x, y, width, height);
  context.fillStyle = bad ? colours.warn : colours.quiet;
  context.fillRect(x, y, at(value) - x, height);
  context.strokeStyle = colours.edge;
  context.strokeRect(x, y, width, height);
  if (mark == null) return;
  context.strokeStyle = colours.ink;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(at(mark), y - 4);
  context.lineTo(at(mark), y + height + 4);
  context.stroke();
  context.lineWidth = 1;
}

export const decisionRows = (decisions) => [...decisions].reverse().map((each) => [number(each.time, 1), each.who, each.what, each.why]);
