// What the operations of a zone are done by: a what-if before, then the set-up, from the desks of all zones that it concerns.
import { blocked, commandButton } from "../command.js";
import { el, number, rebuild, table } from "../dom.js";
import { choice, form } from "../fields.js";
import { deskReason, told, zonesOf } from "./about.js";

/** The form of a zone; operations that no station of it does or could do are left out. */
export function makeSetUp(zone) {
  const fields = el("div");
  const effect = el("div", { role: "status" });
  let choices = new Map();
  let asked = null;

  const changes = () => {
    const line = told();
    return Object.fromEntries([...choices].filter(([name, { input }]) => line && input.value !== line.set_up[name]).map(([name, { input }]) => [name, input.value]));
  };
  const changed = () => JSON.stringify(changes());
  const nothing = () => (Object.keys(changes()).length ? "" : "choose another station for an operation first");
  const whatIf = commandButton({
    name: "predict", title: "What if", form: () => ({ set_up: changes() }), reason: () => blocked("predict") || nothing(),
    done: (result) => {
      asked = result.done ? { changes: changed(), version: told()?.version } : null;
      rebuild(effect, result.done ? result.reply : null, () => (result.done ? shown(result.reply) : []));
      refresh();
    },
  });
  const unseen = () => (asked?.changes === changed() && asked.version === told()?.version ? "" : "ask what it would bring first: What if");
  const setUp = commandButton({
    name: "setup", title: "Set up", form: () => ({ set_up: changes(), based_on: asked.version, why: why.input.value || "from the console" }),
    confirm: () => `The stations do this from now on: ${Object.entries(changes()).map(([name, at]) => `${name} at ${at}`).join(", ")}.`,
    reason: () => blocked("setup") || nothing() || unseen() || deskReason(zonesOf(changes())),
    done: () => { asked = null; effect.replaceChildren(); effect.madeOf = ""; },
  });
  const why = { label: el("label", { for: `why-${zone}` }, "Reason"), input: el("input", { id: `why-${zone}`, maxlength: 200, value: "by hand" }) };

  const shown = (flow) => [
    table("", ["The twins expect, boxes/h", "Now", "Then"], [
      ["Line", number(flow.rate_now, 1), number(flow.rate, 1)],
      ...flow.zones.map((each) => [`Zone ${each.zone}`, number(each.rate_now, 1), number(each.rate, 1)]),
    ], { numeric: [1, 2] }),
  ];

  function refresh() {
    whatIf.refresh();
    setUp.refresh();
  }
  function state() {
    const line = told();
    if (line) {
      const able = (operation) => line.stations.filter((each) => each.able.includes(operation));
      const here = new Set(line.stations.filter((each) => each.zone === zone).map(({ name }) => name));
      const offered = Object.entries(line.set_up)
        .map(([operation, at]) => [operation, at, able(operation)])
        .filter(([, at, can]) => here.has(at) || can.some(({ name }) => here.has(name)));
      // What somebody has chosen stays while the line goes on; another set-up in force begins anew.
      rebuild(fields, [line.version, offered.map(([operation, at, can]) => [operation, at, can.map(({ name }) => name)])], () => {
        choices = new Map(offered.map(([operation, at, can]) => {
          const made = choice(operation, can.map(({ name, zone: other }) => [name, `${name} (zone ${other})${name === at ? ", in force" : ""}`]), at);
          made.input.value = at;
          made.input.addEventListener("change", refresh);
          return [operation, made];
        }));
        return offered.length ? form(...choices.values(), why) : el("p", { class: "why-not" }, "No station of this zone can do an operation.");
      });
    }
    refresh();
  }
  const node = el("div", { class: "stack" }, fields, el("div", { class: "row" }, whatIf.node, setUp.node), effect);
  return { node, state };
}
