// An arm of n joints from its own geometry: where its joints are, seen from the side or from anywhere; drag to turn it.
import { begin, disc, line } from "./canvas.js";

const ELEVATION = 0.35;
const AZIMUTH = -0.9;
const TURN = 0.008;
const ROOM = 22;
const FLOOR = 4;
const LEAST = 0.4;

/** What a canvas shows: its joints (as the state tells them), the tool, and the direction of the look. */
export function chainView(canvas, joints, tool, changed) {
  const view = { canvas, joints, tool, ...lookFor(joints), reach: reachOf(joints, tool), extent: 0 };
  let from = null;
  canvas.addEventListener("pointerdown", (event) => {
    from = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    view.extent = 0;
    view.azimuth -= TURN * (event.clientX - from[0]);
    view.elevation = Math.max(-1.5, Math.min(1.5, view.elevation + TURN * (event.clientY - from[1])));
    from = [event.clientX, event.clientY];
    changed();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
  return view;
}

/** Origins of the joints and the tool in the frame of the base, at some positions. */
export function placesOf(joints, tool, positions) {
  let turn = [1, 0, 0, 0, 1, 0, 0, 0, 1];
  let origin = [0, 0, 0];
  const found = [origin];
  joints.forEach((joint, k) => {
    origin = plus(origin, times(turn, joint.translation));
    turn = product(turn, joint.rotation);
    if (joint.turns) turn = product(turn, about(joint.axis, positions[k]));
    else origin = plus(origin, times(turn, joint.axis.map((x) => x * positions[k])));
    found.push(origin);
  });
  found.push(plus(origin, times(turn, tool.length ? tool : [0, 0, 0])));
  return found;
}

/** Draws the arm of a frame, its path behind it, and the places of its boxes: {name: [x, y, z]}. */
export function drawChain(view, frame, points = {}) {
  const drawing = begin(view.canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const positions = frame?.theta?.length === view.joints.length ? frame.theta : null;
  const shown = [...(positions ? placesOf(view.joints, view.tool, positions) : []), ...Object.values(points)];
  // It grows with what was seen, so that nothing is cut off and nothing jumps.
  for (const point of shown) view.extent = Math.max(view.extent, ...projected(view, point).map(Math.abs));
  const scale = (Math.min(width, height) / 2 - ROOM) / Math.max(view.extent, LEAST * view.reach);
  const at = (point) => {
    const [x, y] = projected(view, point);
    return [width / 2 + scale * x, height / 2 - scale * y];
  };
  if (!view.flat) floor(context, at, view.reach, colours);
  for (const [name, point] of Object.entries(points)) {
    const [x, y] = at(point);
    context.strokeStyle = colours.edge;
    context.strokeRect(x - 6, y - 6, 12, 12);
    context.fillStyle = colours.quiet;
    context.fillText(name, x + 9, y + 4);
  }
  if (!positions) return;
  if (frame.path) line(context, placesOf(view.joints, view.tool, frame.path).map(at), colours.second, 2, [5, 4]);
  const places = placesOf(view.joints, view.tool, positions).map(at);
  line(context, places, colours.ink, 6, []);
  for (const [x, y] of places.slice(1, -1)) disc(context, x, y, 5, colours.panel, colours.ink);
  const [x, y] = places.at(-1);
  disc(context, x, y, 4, frame.gripped ? colours.second : colours.ink, colours.ink);
  if (frame.gripped) {
    context.fillStyle = colours.text;
    context.fillText("box", x + 8, y + 4);
  }
}

/** An arm that moves in a plane is seen along its axes, any other one from above and aside. */
function lookFor(joints) {
  let turn = [1, 0, 0, 0, 1, 0, 0, 0, 1];
  const axes = joints.map((joint) => {
    turn = product(turn, joint.rotation);
    return times(turn, joint.axis);
  });
  const [first] = axes;
  const parallel = joints.every(({ turns }) => turns) && axes.every((axis) => Math.abs(Math.abs(dot(axis, first)) - 1) < 1e-6);
  if (!parallel) return { azimuth: AZIMUTH, elevation: ELEVATION, flat: false };
  // The look goes against the first axis, so that positive positions turn counterclockwise.
  return { azimuth: Math.atan2(first[1], first[0]), elevation: Math.asin(Math.max(-1, Math.min(1, first[2]))), flat: true };
}

/** How far the arm can come, m. */
function reachOf(joints, tool) {
  const lengths = joints.map(({ translation, turns, lower, upper }) =>
    Math.hypot(...translation) + (turns ? 0 : Math.max(Math.abs(lower ?? 0), Math.abs(upper ?? 0))));
  return Math.max(0.05, lengths.reduce((sum, length) => sum + length, Math.hypot(...(tool.length ? tool : [0]))));
}

function projected({ azimuth, elevation }, [x, y, z]) {
  const [c, s] = [Math.cos(azimuth), Math.sin(azimuth)];
  const across = -s * x + c * y;
  const away = c * x + s * y;
  return [across, Math.cos(elevation) * z - Math.sin(elevation) * away];
}

function floor(context, at, reach, colours) {
  context.strokeStyle = colours.faint;
  context.lineWidth = 1;
  for (let k = -FLOOR; k <= FLOOR; k += 1) {
    const place = (0.4 * reach * k) / FLOOR;
    for (const ends of [[[place, -0.4 * reach, 0], [place, 0.4 * reach, 0]], [[-0.4 * reach, place, 0], [0.4 * reach, place, 0]]]) line(context, ends.map(at), colours.faint, 1, []);
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b) => a.map((value, k) => value + b[k]);
const times = (m, v) => [0, 1, 2].map((row) => m[3 * row] * v[0] + m[3 * row + 1] * v[1] + m[3 * row + 2] * v[2]);
const product = (a, b) => [0, 1, 2].flatMap((row) => [0, 1, 2].map((k) => a[3 * row] * b[k] + a[3 * row + 1] * b[3 + k] + a[3 * row + 2] * b[6 + k]));

/** The rotation about a unit axis (Rodrigues). */
function about([x, y, z], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const v = 1 - c;
  return [x * x * v + c, x * y * v - z * s, x * z * v + y * s, x * y * v + z * s, y * y * v + c, y * z * v - x * s, x * z * v - y * s, y * z * v + x * s, z * z * v + c];
}
