// A moving analogue indicator (ISA-101): a scale with its normal band and limits, a pointer for the value, a mark for
// the target. A value beyond its limit gets a filled triangle and a word, not a colour alone.
import { begin } from "./canvas.js";
import { number } from "./dom.js";

/** scales: [{unit, low, high, value, target, band: [low, high], limit, digits}] side by side. */
export function drawIndicators(canvas, scales) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const wide = width / scales.length;
  scales.forEach((scale, index) => drawScale(context, colours, scale, index * wide, wide, height));
}

function drawScale(context, colours, scale, left, wide, height) {
  const top = 18;
  const bottom = height - 34;
  const x = left + wide * 0.34;
  const bar = 16;
  const at = (value) => bottom - ((Math.max(scale.low, Math.min(scale.high, value)) - scale.low) / (scale.high - scale.low)) * (bottom - top);
  context.textAlign = "left";
  context.fillStyle = colours.quiet;
  context.fillText(scale.unit, left + 2, 11);
  context.strokeStyle = colours.edge;
  context.fillStyle = colours.panel;
  context.fillRect(x, top, bar, bottom - top);
  if (scale.band) {
    context.fillStyle = colours.band;
    context.fillRect(x, at(scale.band[1]), bar, at(scale.band[0]) - at(scale.band[1]));
  }
  context.strokeRect(x, top, bar, bottom - top);
  for (const limit of scale.limits ?? []) {
    context.lineWidth = 2;
    context.strokeStyle = colours.ink;
    context.beginPath();
    context.moveTo(x - 5, at(limit));
    context.lineTo(x + bar + 5, at(limit));
    context.stroke();
    context.lineWidth = 1;
  }
  if (scale.target != null) {
    const y = at(scale.target);
    context.strokeStyle = colours.second;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x - 2, y);
    context.lineTo(x - 12, y - 6);
    context.lineTo(x - 12, y + 6);
    context.closePath();
    context.stroke();
    context.lineWidth = 1;
  }
  if (scale.value == null) return;
  const beyond = (scale.limits ?? []).some((limit) => (limit > 0 ? scale.value >= limit : scale.value <= limit));
  const odd = scale.band && (scale.value < scale.band[0] || scale.value > scale.band[1]);
  const y = at(scale.value);
  context.fillStyle = beyond ? colours.severe : odd ? colours.warn : colours.ink;
  context.beginPath();
  context.moveTo(x + bar - 2, y);
  context.lineTo(x + bar + 13, y - 7);
  context.lineTo(x + bar + 13, y + 7);
  context.closePath();
  context.fill();
  context.fillStyle = colours.text;
  context.fillText(number(scale.value, scale.digits), left + 2, bottom + 15);
  if (beyond || odd) {
    context.fillStyle = beyond ? colours.severe : colours.warn;
    context.fillText(beyond ? "▲ limit" : "△ unusual", left + 2, bottom + 30);
  }
}
