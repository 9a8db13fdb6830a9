// Level 1: the line at a glance, its zones as blocks in the order in which boxes pass them.
import { begin } from "../canvas.js";
import { el, figures, number, panel, rebuild, table } from "../dom.js";
import { drawTrend } from "../trend.js";
import { store } from "../store.js";
import { ability, decisionRows, doing, drawBar, expectedOf, makeDesk, oee, operationsOf, percent, plan, several, told, twinUnheard } from "./about.js";
import { makeProposals } from "./proposals.js";

const HOUR = 3600;
const MODES = { act: "act", propose: "propose", off: "are off", silent: "are silent" };
// Below this share of what the twins expect, a rate is drawn as abnormal.
const SLOW = 0.85;

export function makeLine() {
  const flow = el("div", { class: "flow", role: "group", "aria-label": "Zones in the order in which boxes pass them" });
  const trend = el("canvas", { class: "trend grow", role: "img", "aria-label": "Boxes an hour over the last hour, beside what the twins expect" });
  const counts = el("div", { class: "value" });
  const setUp = el("p", { class: "value" });
  const decisions = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Decisions and findings" });
  const proposals = makeProposals();
  const node = el("div", { class: "grid filling line" },
    panel("Line", "w12", flow, setUp),
    panel("Throughput", "w4", counts, trend),
    panel("Proposals", "w4", proposals.node),
    panel("Decisions and findings", "w4", decisions));
  let blocks = [];
  let madeOf = "";

  function make(line) {
    const key = JSON.stringify([line.zones.map(({ name }) => name), line.stations.map(({ name }) => name), Boolean(plan())]);
    if (key === madeOf) return;
    madeOf = key;
    blocks = line.zones.map(({ name }) => zoneBlock(name));
    const parts = [ends("Source")];
    blocks.forEach((block, number_) => {
      parts.push(arrow(), block.node);
      if (number_ < blocks.length - 1) parts.push(arrow(), buffer(number_));
    });
    flow.replaceChildren(...parts.map((part) => part.node ?? part), arrow(), ends("Sink").node);
    others = [...flow.querySelectorAll("[data-part]")];
  }
  let others = [];

  function state() {
    const line = told();
    proposals.state();
    if (!line) {
      rebuild(flow, "nothing", () => el("p", { class: "why-not" }, store.state?.line?.lost || "Nothing is heard of the line yet."));
      madeOf = "";
      return;
    }
    make(line);
    blocks.forEach((block) => block.state(line));
    for (const part of others) part.refresh(line);
    const expected = store.state.line.expected;
    rebuild(counts, [line.rate, line.left, line.inside, line.entered, line.lost, line.collisions, line.late, expected?.rate_now, line.every], () => figures([
      ["Boxes/h, 10 minutes", line.rate ? el("strong", { class: "big" }, number(line.rate, 1)) : "not yet"],
      ["Twins expect", !expected ? "–" : expected.rate_now ? number(expected.rate_now, 1) : el("span", { class: "tag warn" }, "△ 0: a station cannot")],
      ["Source brings", line.every ? number(HOUR / line.every, 1) : "not known"],
      ["Entered, inside, left", `${line.entered}, ${line.inside}, ${line.left}`],
      ["Lost, touches, late", `${line.lost}, ${line.collisions}, ${line.late}`],
    ]));
    rebuild(setUp, [line.set_up, line.version, line.twins, expected, store.state.line.lost], () => [
      `Set-up ${line.version} in force: `,
      ...Object.entries(line.set_up).flatMap(([operation, at], k) => [k ? " → " : "", `${operation} at `, stationLink(at)]),
      `; the twins ${MODES[line.twins] ?? line.twins}`,
      store.state.line.lost ? el("span", { class: "tag severe" }, `▲ ${store.state.line.lost}`) : null,
      expected?.difference.length ? `. Best there is: ${number(expected.rate, 1)} boxes/h, ${expected.difference.join("; ")}` : null,
    ].filter((each) => each != null).map((each) => (each.nodeType ? each : document.createTextNode(each))));
    rebuild(decisions, [line.decisions, twinUnheard()], () => table("Plant time, newest first", ["s", "Who", "What", "Why"], decisionRows(line.decisions), { numeric: [0], empty: twinUnheard() ? "What was decided is not known." : "Nothing was decided yet." }));
  }

  function draw() {
    const line = store.state?.line;
    blocks.forEach((block) => block.draw(line));
    if (!line?.state) return;
    const rows = line.trend;
    const trends = { length: rows.length, value: (row, column) => rows[row][column], place: () => 1, last: rows.at(-1)?.[0] ?? 0 };
    const from = Math.max(0, (rows[0]?.[0] ?? 0));
    drawTrend(trend, trends, {
      title: "Boxes/h, mean of 10 minutes", unit: "last hour", span: Math.max(600, Math.min(HOUR, trends.last - from)),
      lines: [{ of: (value) => value("rate") || NaN }], levels: line.expected?.rate_now ? [{ value: line.expected.rate_now, name: "twins expect" }] : [],
      range: [0, 1.2 * Math.max(1, HOUR / (line.state.every || Infinity), ...rows.map(([, rate]) => rate))],
    });
  }
  return { node, state, draw };
}

const stationLink = (name) => el("a", { href: `#station/${name}` }, name);
const arrow = () => el("span", { class: "arrow", "aria-hidden": "true" }, "→");

function part(refresh) {
  const node = el("div", { class: "end", "data-part": true });
  node.refresh = (line) => refresh(node, line);
  return node;
}

function ends(title) {
  const source = title === "Source";
  return { node: part((node, line) => rebuild(node, [line.outside, line.left, line.every], () => [
    el("h3", {}, title),
    el("span", { class: "value" }, source ? (line.every ? `every ${number(line.every, 0)} s` : "not known") : `${line.left} left`),
    source ? el("span", { class: line.outside > 2 ? "tag warn" : "quiet" }, `${line.outside > 2 ? "△ " : ""}${line.outside} wait`) : null,
  ].filter(Boolean))) };
}

function buffer(index) {
  return { node: part((node, line) => {
    const capacity = plan()?.buffers[index]?.capacity ?? 0;
    const behind = line.zones[index]?.behind ?? 0;
    rebuild(node, [behind, capacity], () => [
      el("h3", {}, "Buffer"),
      el("span", { class: "slots", role: "img", "aria-label": capacity ? `${behind} of ${capacity} boxes` : several(behind, "box", "boxes") },
        ...Array.from({ length: Math.min(capacity, 12) }, (_, k) => el("span", { class: `slot${k < behind ? " full" : ""}` }))),
      el("span", { class: "value" }, capacity ? `${behind} of ${capacity}` : `${behind}`),
    ]);
  }) };
}

function zoneBlock(name) {
  const rate = el("canvas", { class: "rate", role: "img", "aria-label": `Boxes an hour of zone ${name} beside what its twin expects` });
  const words = el("p", { class: "value" });
  const stations = el("div", { class: "value" });
  const desk = makeDesk(name);
  const node = el("section", { class: "block", "aria-labelledby": `zone-${name}` },
    el("div", { class: "row" }, el("h3", { id: `zone-${name}` }, el("a", { href: `#zone/${name}` }, `Zone ${name}`)), desk.node), words, rate, stations);
  function state(line) {
    desk.refresh();
    const zone = line.zones.find((each) => each.name === name);
    const own = line.stations.filter((each) => each.zone === name);
    const vehicles = line.vehicles.filter((each) => each.zone === name);
    const loaded = vehicles.filter(({ box }) => box).length;
    const expected = expectedOf(name);
    rebuild(words, [zone, loaded, vehicles.length, expected?.rate_now], () => document.createTextNode(
      `${zone.rate ? `${number(zone.rate, 0)} boxes/h` : "no rate yet"}${expected ? `, could let ${number(expected.rate_now, 0)} through` : ""}; ${several(zone.inside, "box", "boxes")}, ${loaded} of ${vehicles.length} vehicles loaded`));
    rebuild(stations, [own, line.set_up], () => table("", ["Station", "Does", "Now", "OEE", "Its arm can do"],
      own.map((each) => [stationLink(each.name), operationsOf(each.name).join(", ") || "nothing", doing(each), percent(oee(each)), ability(each)]), { numeric: [3], empty: "No station." }));
  }
  function draw(line) {
    const drawing = begin(rate);
    if (!drawing || !line?.state) return;
    const expected = expectedOf(name)?.rate_now ?? 0;
    const zone = line.state.zones.find((each) => each.name === name);
    const source = HOUR / (line.state.every || Infinity);
    const due = Math.min(source, expected || source);
    drawBar(drawing.context, drawing.colours, { x: 1, y: 5, width: drawing.width - 2, height: drawing.height - 10 },
      { value: zone?.rate ?? 0, full: 1.25 * Math.max(source, expected), mark: due, bad: Boolean(zone?.rate) && zone.rate < SLOW * due });
  }
  return { node, state, draw };
}
