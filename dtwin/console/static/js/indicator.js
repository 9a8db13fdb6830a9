// A moving analogue indicator (ISA-101): a scale with its normal band and limits, a pointer for the value, a mark for
// the target. A value beyond its limit gets a filled triangle and a word, not a colour alone; one beyond the scale is
// marked, too, since its pointer stands at the end of the scale.
import { begin } from "./canvas.js";

const BAR = 16;

/** scales: [{low, high, value, target, band: [low, high], limits}] side by side. */
export function drawIndicators(canvas, scales) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const wide = width / scales.length;
  scales.forEach((scale, index) => drawScale(context, colours, scale, index * wide, wide, height));
}

function drawScale(context, colours, scale, left, wide, height) {
  const top = 14;
  const bottom = height - 34;
  const x = left + Math.max(14, 0.3 * wide);
  const at = (value) => bottom - ((Math.max(scale.low, Math.min(scale.high, value)) - scale.low) / (scale.high - scale.low)) * (bottom - top);
  context.textAlign = "left";
  context.strokeStyle = colours.edge;
  context.fillStyle = colours.panel;
  context.fillRect(x, top, BAR, bottom - top);
  if (scale.band) {
    context.fillStyle = colours.band;
    context.fillRect(x, at(scale.band[1]), BAR, at(scale.band[0]) - at(scale.band[1]));
  }
  context.strokeRect(x, top, BAR, bottom - top);
  for (const limit of scale.limits ?? []) {
    context.lineWidth = 2;
    context.strokeStyle = colours.ink;
    context.beginPath();
    context.moveTo(x - 5, at(limit));
    context.lineTo(x + BAR + 5, at(limit));
    context.stroke();
    context.lineWidth = 1;
  }
  if (scale.target != null) {
    triangle(context, [x - 2, at(scale.target)], [-10, 6]);
    context.strokeStyle = colours.second;
    context.lineWidth = 2;
    context.stroke();
    context.lineWidth = 1;
  }
  if (scale.value == null) return;
  const { beyond, odd, off } = judged(scale);
  context.fillStyle = beyond ? colours.severe : odd ? colours.warn : colours.ink;
  triangle(context, [x + BAR - 2, at(scale.value)], [15, 7]);
  context.fill();
  if (off) chevrons(context, x + BAR / 2, off > 0 ? top - 3 : bottom + 3, off, colours.ink);
  // Words keep to their column.
  const say = (text, line) => context.fillText(text, left + 2, bottom + line, wide - 4);
  if (beyond || odd) say(beyond ? "▲ limit" : "△ unusual", 17);
  context.fillStyle = colours.text;
  if (off) say(`${off > 0 ? "↑" : "↓"} off scale`, 31);
}

/** Whether a value is beyond a limit, outside of its normal band, and off the scale: 1 above, -1 below. */
function judged({ value, low, high, band, limits = [] }) {
  return {
    beyond: limits.some((limit) => (limit > 0 ? value >= limit : value <= limit)),
    odd: band && (value < band[0] || value > band[1]),
    off: value > high ? 1 : value < low ? -1 : 0,
  };
}

function triangle(context, [x, y], [across, half]) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + across, y - half);
  context.lineTo(x + across, y + half);
  context.closePath();
}

function chevrons(context, x, y, way, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 2;
  context.beginPath();
  for (const step of [0, 4]) {
    context.moveTo(x - 6, y - way * step);
    context.lineTo(x, y - way * (step + 4));
    context.lineTo(x + 6, y - way * step);
  }
  context.stroke();
  context.lineWidth = 1;
}
