// Level 2: a zone by selection: its track, its stations and vehicles, who works on what, and the set-up of its operations.
import { el, number, panel, rebuild, table } from "../dom.js";
import { store } from "../store.js";
import { ability, box, doing, expectedOf, makeDesk, oee, operationsOf, percent, plan, several, stationButtons, told } from "./about.js";
import { makeSetUp } from "./setup.js";
import { drawTrack } from "./track.js";

const LOW = 20;

export function makeZone(zone) {
  const track = el("canvas", { class: "track", role: "img", "aria-label": `Track of zone ${zone} with its stations, vehicles and boxes` });
  const stations = el("div", { class: "value" });
  const vehicles = el("div", { class: "value" });
  const facts = el("p", { class: "value" });
  const desk = makeDesk(zone);
  const setUp = makeSetUp(zone);
  const hands = el("div", { class: "row" });
  let buttons = [];
  const node = el("div", { class: "grid filling zone" },
    panel(`Zone ${zone}`, "w7", el("div", { class: "row" }, facts, desk.node), track,
      el("p", { class: "legend" }, "● vehicle, ■ box with its number; dotted: given to a vehicle; at a station from the left: waits, worked at, finished")),
    el("div", { class: "column w5" }, panel("Stations", "", stations, hands), panel("Set-up of its operations", "grow", setUp.node)),
    panel("Vehicles", "w12", vehicles));

  function state() {
    desk.refresh();
    setUp.state();
    const line = told();
    const seen = line?.zones.find((each) => each.name === zone);
    if (!seen) {
      rebuild(facts, [store.state?.line?.lost, Boolean(line)], () => document.createTextNode(line ? `There is no zone ${zone}.` : store.state?.line?.lost || "Nothing is heard of the line yet."));
      return;
    }
    const expected = expectedOf(zone);
    rebuild(facts, [seen, expected?.rate_now], () => document.createTextNode(
      `${seen.rate ? `${number(seen.rate, 1)} boxes/h` : "no rate yet"}${expected ? `, could let ${number(expected.rate_now, 1)} through` : ""}; ${several(seen.inside, "box", "boxes")} inside`));
    const own = line.stations.filter((each) => each.zone === zone);
    rebuild(stations, [own, line.set_up], () => table("Boxes by number: waits, worked at, finished", ["Station", "Does", "Now", "Boxes", "OEE", "Can do"],
      own.map((each) => [el("a", { href: `#station/${each.name}` }, each.name), operationsOf(each.name).join(", ") || "nothing", doing(each),
        [each.waiting, each.worked, each.finished].map(box).join(", "), percent(oee(each)), ability(each)]),
      { numeric: [4], empty: "No station." }));
    rebuild(hands, own.map(({ name }) => name), () => {
      buttons = own.map(({ name }) => stationButtons(name, zone));
      return buttons.flatMap((each) => each.nodes);
    });
    buttons.forEach((each) => each.refresh());
    const drives = line.vehicles.filter((each) => each.zone === zone);
    rebuild(vehicles, drives.map((each) => ({ ...each, position: null })), () => table("", ["Vehicle", "Now", "Box", "Last node", "Was given", "Battery"],
      drives.map((each) => [each.name, `${each.doing}${each.handling ? ", handles a box" : ""}`, box(each.box), each.path[0] ?? "", each.path.slice(1).join(" › ") || "–",
        each.battery < LOW ? el("span", { class: "tag warn" }, `△ ${number(each.battery, 0)} %`) : `${number(each.battery, 0)} %`]), { numeric: [2, 5], empty: "No vehicle." }));
  }
  function draw() {
    const built = plan()?.zones.find((each) => each.name === zone);
    if (built && told()) drawTrack(track, built, told());
  }
  return { node, state, draw };
}
