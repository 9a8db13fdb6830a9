// The arm from its angles: link 1 from the origin, each joint relative to the link before; places as the cell has them.
import { begin, disc, line } from "./canvas.js";

const LENGTHS = [0.15786938, 0.13246938, 0.1608];
const PICKUP = "pickup";
const ROOM = 0.06;
// What the arm can reach from joint 1, m: it may hang, and be turned anywhere; and the jaws beyond it, in units of the drawing.
const REACH = LENGTHS[0] + LENGTHS[1] + LENGTHS[2];
const JAWS = 18;
const OPEN = 0.9;
const CLOSED = 0.39265;

export function joints(theta) {
  const points = [[0, 0]];
  let angle = 0;
  theta.forEach((value, link) => {
    angle += value;
    const [x, y] = points[link];
    points.push([x + LENGTHS[link] * Math.cos(angle), y + LENGTHS[link] * Math.sin(angle)]);
  });
  return points;
}

/** What is shown, m: all that the arm can reach, and every place with room around it. */
function extent(places) {
  const spots = Object.values(places);
  const [xs, ys] = [spots.map(({ x }) => x), spots.map(({ y }) => y)];
  return {
    left: Math.min(-REACH, ...xs.map((x) => x - ROOM)), right: Math.max(REACH, ...xs.map((x) => x + ROOM)),
    low: Math.min(-REACH, ...ys.map((y) => y - ROOM)), high: Math.max(REACH, ...ys.map((y) => y + ROOM)),
  };
}

/** Draws the last frame; places: {name: {x, y, rgb}}, in metres from joint 1. */
export function drawArm(canvas, frame, places = {}) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const shown = extent(places);
  const scale = Math.min((width - 2 * JAWS) / (shown.right - shown.left), (height - 2 * JAWS) / (shown.high - shown.low));
  const middle = [(shown.left + shown.right) / 2, (shown.low + shown.high) / 2];
  const at = ([x, y]) => [width / 2 + scale * (x - middle[0]), height / 2 - scale * (y - middle[1])];
  for (const [name, place] of Object.entries(places)) {
    const [x, y] = at([place.x, place.y]);
    context.strokeStyle = colours.faint;
    context.strokeRect(x - 9, y - 9, 18, 18);
    if (place.rgb) line(context, [[x - 9, y + 9], [x + 9, y + 9]], place.rgb, 4, []);
    context.fillStyle = colours.quiet;
    context.fillText(name, x + 13, y + 4);
  }
  if (!frame?.theta) return;
  if (frame.box && places[PICKUP]) {
    const [x, y] = at([places[PICKUP].x, places[PICKUP].y]);
    box(context, colours, x, y, frame.box, places[frame.box]?.rgb);
  }
  if (frame.path) line(context, joints(frame.path).map(at), colours.second, 2, [5, 4]);
  const points = joints(frame.theta).map(at);
  line(context, points, colours.ink, 7, []);
  for (const [x, y] of points.slice(0, 3)) disc(context, x, y, 6, colours.panel, colours.ink);
  const tip = points[3];
  const angle = frame.theta[0] + frame.theta[1] + frame.theta[2];
  const spread = 0.15 + 0.5 * Math.max(0, Math.min(1, (frame.gripper - CLOSED) / (OPEN - CLOSED)));
  for (const side of [-spread, spread]) {
    const end = [tip[0] + 16 * Math.cos(angle + side), tip[1] - 16 * Math.sin(angle + side)];
    line(context, [tip, end], colours.ink, 3, []);
  }
  if (frame.gripped) box(context, colours, tip[0] + 10 * Math.cos(angle), tip[1] - 10 * Math.sin(angle), "held");
}

function box(context, colours, x, y, name, rgb = "") {
  context.fillStyle = rgb || colours.second;
  context.fillRect(x - 7, y - 7, 14, 14);
  context.fillStyle = colours.text;
  context.fillText(name === "held" ? "box" : `${name} box`, x - 12, y + 21);
}
