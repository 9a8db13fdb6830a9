// What the twins or an AI have proposed for a line: who, why, what changes, what the twins expect; approved or declined from the desks of all zones that it concerns.
import { blocked, commandButton } from "../command.js";
import { el, number, rebuild, table } from "../dom.js";
import { store } from "../store.js";
import { deskReason, told, twinUnheard, zonesOf } from "./about.js";

const SHOWN = 5;

const zoneOf = (name) => told()?.stations.find((station) => station.name === name)?.zone ?? "";

export function makeProposals() {
  const node = el("div", { class: "scroll stack", tabindex: "0", role: "region", "aria-label": "Proposals" });
  let buttons = [];

  function state() {
    const proposals = [...(store.state?.proposals ?? [])].reverse();
    // What waits for a person comes first.
    const shown = [...proposals.filter((each) => each.state === "open"), ...proposals.filter((each) => each.state !== "open")].slice(0, SHOWN);
    rebuild(node, [shown, twinUnheard()], () => {
      buttons = [];
      return shown.length ? shown.map(one) : el("p", { class: "why-not" }, twinUnheard() ? "What was proposed is not known." : "Neither the twins nor an AI have proposed anything.");
    });
    buttons.forEach((button) => button.refresh());
  }

  function one({ number: count, digest, request, flow, time, state: became, by, outcome }) {
    const open = became === "open";
    const came = [became, by, outcome].filter(Boolean).join(", ");
    const parts = [el("p", {}, open ? el("span", { class: "tag warn" }, `△ ${count}. waits for a person`) : `${count}. ${came}:`, ` ${request.kind} by ${request.who}, ${number(time, 1)} s`)];
    if (flow) parts.push(el("p", {}, flow.difference.join("; ") || "nothing changes"));
    const { settle } = request;
    if (settle) parts.push(el("p", {}, `${settle.station} ${settle.releases ? "is released and works" : "works on"} with ${settle.settings}: it can do ${settle.ability} then`));
    if (open) {
      const form = () => ({ number: count, digest });
      const changes = request.set_up?.set_up ?? {};
      const reason = (name) => () => blocked(name) || deskReason(settle ? [zoneOf(settle.station)] : zonesOf(changes));
      const made = [
        commandButton({ name: "approve", title: `Approve ${count}`, confirm: `What is shown of proposal ${count} is carried out in your name.`, form, reason: reason("approve") }),
        commandButton({ name: "decline", title: `Decline ${count}`, form, reason: reason("decline") }),
      ];
      buttons.push(...made);
      parts.push(el("div", { class: "row" }, ...made.map((button) => button.node)));
    }
    if (flow && open) {
      parts.push(table("What the twins expect, boxes/h", ["", "Now", "Proposed"], [
        ["Line", number(flow.rate_now, 1), number(flow.rate, 1)],
        ...flow.zones.map((each) => [`Zone ${each.zone}`, number(each.rate_now, 1), number(each.rate, 1)]),
      ], { numeric: [1, 2] }));
    }
    parts.push(el("p", { class: "quiet" }, `“${request.why}”`));
    return el("article", { class: "stack" }, ...parts);
  }
  return { node, state };
}
