// The track of a zone: nodes, segments, docks, vehicles with their boxes, and what they hold of it.
import { begin, disc, line } from "../canvas.js";

// Room around the track for stations above it and words below it, in units of the drawing, and beside it, m.
const ABOVE = 62;
const BELOW = 40;
const BESIDE = 0.9;
const ARROW = 5;
const LOW = 20;

/** Draws a zone as it was built, and its stations and vehicles as they are. */
export function drawTrack(canvas, zone, state) {
  const drawing = begin(canvas);
  if (!drawing || !zone) return;
  const { context, width, height, colours } = drawing;
  const points = Object.values(zone.nodes);
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  const [left, right, low, high] = [Math.min(...xs) - BESIDE, Math.max(...xs) + BESIDE, Math.min(...ys), Math.max(...ys)];
  const scale = Math.min(width / (right - left), Math.max(1, height - ABOVE - BELOW) / Math.max(high - low, 1));
  const middle = (height + ABOVE - BELOW) / 2;
  const at = ([x, y]) => [width / 2 + scale * (x - (left + right) / 2), middle - scale * (y - (low + high) / 2)];
  const both = new Set(zone.segments.map(([a, b]) => `${a}>${b}`));
  const vehicles = state.vehicles.filter((each) => each.zone === zone.name);
  const held = new Map(vehicles.flatMap(({ name, path }) => path.slice(1).map((node, k) => [`${path[k]}>${node}`, name])));
  context.textAlign = "center";
  for (const [a, b] of zone.segments) {
    if (both.has(`${b}>${a}`) && a > b) continue;
    const [from, to] = [at(zone.nodes[a]), at(zone.nodes[b])];
    line(context, [from, to], colours.edge, 2, []);
    if (!both.has(`${b}>${a}`)) arrow(context, from, to, colours.edge);
  }
  for (const way of held.keys()) {
    const [a, b] = way.split(">");
    if (zone.nodes[a] && zone.nodes[b]) line(context, [at(zone.nodes[a]), at(zone.nodes[b])], colours.second, 5, [2, 7]);
  }
  const docks = new Map(zone.stations.map(({ name, node }) => [node, name]));
  for (const [name, point] of Object.entries(zone.nodes)) if (!docks.has(name)) disc(context, ...at(point), 3, colours.panel, colours.edge);
  ends(context, colours, zone, at, new Set(vehicles.map(({ path }) => path[0])));
  for (const [node, name] of docks) station(context, colours, at(zone.nodes[node]), state.stations.find((each) => each.name === name));
  for (const vehicle of vehicles) drawVehicle(context, colours, at(vehicle.position), vehicle, Math.max(9, 0.3 * scale));
  context.textAlign = "left";
}

function ends(context, colours, zone, at, taken) {
  context.fillStyle = colours.quiet;
  const name = (node, words) => {
    if (!zone.nodes[node]) return;
    const [x, y] = at(zone.nodes[node]);
    context.strokeStyle = colours.edge;
    context.strokeRect(x - 9, y - 9, 18, 18);
    context.fillText(words, x, y - 14);
  };
  name(zone.entry, "boxes in");
  name(zone.exit, "boxes out");
  for (const home of new Set(Object.values(zone.homes))) {
    const [x, y] = at(zone.nodes[home]);
    context.strokeStyle = colours.edge;
    context.setLineDash([3, 3]);
    context.strokeRect(x - 13, y - 13, 26, 26);
    context.setLineDash([]);
    if (!taken.has(home)) context.fillText("home", x, y + 26);
  }
}

function station(context, colours, [x, y], state) {
  if (!state) return;
  const bad = state.doing === "stopped" ? colours.severe : state.ability !== "all" ? colours.warn : null;
  const [half, top] = [40, y - 54];
  context.fillStyle = colours.ground;
  context.fillRect(x - half, top, 2 * half, 42);
  context.strokeStyle = bad ?? colours.ink;
  context.lineWidth = bad ? 3 : 1.5;
  context.strokeRect(x - half, top, 2 * half, 42);
  context.lineWidth = 1;
  context.fillStyle = bad ?? colours.text;
  context.fillText(`${bad ? (state.doing === "stopped" ? "▲ " : "△ ") : ""}${state.name}`, x, top + 15, 2 * half - 6);
  [state.waiting, state.worked, state.finished].forEach((box, k) => {
    const left = x - 27 + 19 * k;
    context.strokeStyle = colours.edge;
    context.fillStyle = box ? colours.quiet : colours.panel;
    context.fillRect(left, top + 22, 15, 13);
    context.strokeRect(left, top + 22, 15, 13);
    if (!box) return;
    context.fillStyle = colours.panel;
    context.font = "9px system-ui, sans-serif";
    context.fillText(String(box), left + 7.5, top + 32, 14);
    context.font = "12px system-ui, sans-serif";
  });
  disc(context, x, y, 4, colours.panel, colours.ink);
}

function drawVehicle(context, colours, [x, y], { name, box, battery, handling }, radius) {
  disc(context, x, y, radius, colours.panel, battery < LOW ? colours.warn : colours.ink);
  if (box) {
    context.fillStyle = colours.quiet;
    context.fillRect(x - 8, y - 8, 16, 16);
    context.fillStyle = colours.panel;
    context.font = "10px system-ui, sans-serif";
    context.fillText(String(box), x, y + 4, 15);
    context.font = "12px system-ui, sans-serif";
  }
  context.fillStyle = battery < LOW ? colours.warn : colours.text;
  context.fillText(`${name}${handling ? " ⇄" : ""}${battery < LOW ? ` △ ${battery.toFixed(0)} %` : ""}`, x, y + radius + 13);
}

function arrow(context, from, to, colour) {
  const [x, y] = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
  context.fillStyle = colour;
  context.beginPath();
  context.moveTo(x + ARROW * Math.cos(angle), y + ARROW * Math.sin(angle));
  for (const side of [2.5, -2.5]) context.lineTo(x + ARROW * Math.cos(angle + side), y + ARROW * Math.sin(angle + side));
  context.fill();
}
