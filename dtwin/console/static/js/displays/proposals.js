// What recovery or an AI has proposed: who, why, what changes, what the twin expects; a person approves or declines what is shown.
import { commandButton } from "../command.js";
import { each, el, number, rebuild, table } from "../dom.js";
import { store } from "../store.js";

const milli = (values) => (values == null ? "refused" : each(values.map((value) => 1000 * value), 1));

export function makeProposals() {
  const node = el("div", { class: "stack" });
  let buttons = [];

  function state() {
    const told = [...(store.state?.proposals ?? [])].reverse();
    rebuild(node, told, () => {
      buttons = [];
      return told.length ? told.map(one) : el("p", { class: "why-not" }, "Neither recovery nor an AI has proposed anything.");
    });
    // What waits for a person comes before everything else.
    node.parentElement.style.order = told.some((proposal) => proposal.state === "open") ? -1 : 0;
    buttons.forEach((button) => button.refresh());
  }

  function one(proposal) {
    const { number: count, digest, request, effect } = proposal;
    const name = `proposal ${count}`;
    const came = [proposal.state, proposal.by, proposal.outcome].filter(Boolean).join(", ");
    const subject = request.parameters.length ? `${request.kind} ${request.parameters.join(", ")}` : request.kind;
    const parts = [el("p", {}, `${count}. ${subject}, by ${request.who} at ${number(proposal.time, 1)} s: ${came}`), el("p", {}, `“${request.why}”`)];
    if (request.text) parts.push(el("p", {}, `“${request.text}”`));
    if (effect) {
      parts.push(el("p", {}, effect.difference.join("; ") || "nothing changes"));
      parts.push(table(`What the twin expects of ${name}`, ["", "In force", "Proposed"], [
        ["Farthest from the path, mrad", milli(effect.tracking_now), milli(effect.tracking)],
        ["Disk margin", number(effect.disk_margin_now, 2), number(effect.disk_margin, 2)],
        ["Peak voltage, V", "", each(effect.peak_volts, 1)],
      ], { numeric: [1, 2] }));
    }
    if (proposal.state === "open") {
      const form = () => ({ number: count, digest });
      const made = [
        commandButton({ name: "approve", title: `Approve ${name}`, confirm: `What is shown of ${name} is carried out in your name: ${subject}.`, form }),
        commandButton({ name: "decline", title: `Decline ${name}`, form }),
      ];
      buttons.push(...made);
      parts.push(el("div", { class: "row" }, ...made.map((button) => button.node)));
    }
    return el("article", { class: "stack" }, ...parts);
  }
  return { node, state };
}
