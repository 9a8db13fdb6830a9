// The arm from its angles: link 1 from the origin, each joint relative to the link before.
import { begin } from "./canvas.js";

const LENGTHS = [0.15786938, 0.13246938, 0.1608];
const PLACES = { pickup: [0.2, -0.2], blue: [0.1, 0], red: [0.15, 0.15], green: [0.15, 0.28] };
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

export function drawArm(canvas, frame) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const scale = Math.min(width / 0.95, height / 0.86);
  const at = ([x, y]) => [width * 0.45 + scale * x, height * 0.56 - scale * y];
  context.strokeStyle = colours.faint;
  context.fillStyle = colours.quiet;
  for (const [name, place] of Object.entries(PLACES)) {
    const [x, y] = at(place);
    context.strokeRect(x - 9, y - 9, 18, 18);
    context.fillText(name, x + 13, y + 4);
  }
  if (!frame?.theta) return;
  if (frame.box) {
    const [x, y] = at(PLACES.pickup);
    box(context, colours, x, y, frame.box);
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

function box(context, colours, x, y, name) {
  context.fillStyle = colours.second;
  context.fillRect(x - 7, y - 7, 14, 14);
  context.fillStyle = colours.text;
  context.fillText(name === "held" ? "box" : `${name} box`, x - 12, y + 21);
}

function line(context, points, colour, width, dash) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineCap = context.lineJoin = "round";
  context.setLineDash(dash);
  context.beginPath();
  points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
  context.setLineDash([]);
  context.lineWidth = 1;
}

function disc(context, x, y, radius, fill, edge) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = edge;
  context.lineWidth = 2;
  context.stroke();
  context.lineWidth = 1;
}
