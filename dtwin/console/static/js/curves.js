// Curves against time or against each other, from arrays.
import { begin } from "./canvas.js";

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3], [4, 2], [1, 2]];

/** lines: [{x: numbers, y: numbers, dash, faint, name}], marks: [{x, y, name, filled}], levels: numbers */
export function drawCurves(canvas, { title, unit, across, lines = [], marks = [], levels = [], points = [] }) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const [left, right, top, bottom] = [52, width - 8, 18, height - 28];
  context.fillStyle = colours.quiet;
  context.fillText(`${title}, ${unit}`, 4, 12);
  const xs = [...lines.flatMap((line) => line.x), ...marks.map((mark) => mark.x), ...points.map((point) => point[0])];
  const ys = [...lines.flatMap((line) => line.y), ...marks.map((mark) => mark.y), ...points.map((point) => point[1]), ...levels];
  if (!xs.length) {
    context.fillText("nothing yet", left, (top + bottom) / 2);
    return;
  }
  const range = (values) => {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    const margin = 0.06 * (high - low) || 1;
    return [low - margin, high + margin];
  };
  const [low, high] = range(ys);
  const [first, last] = range(xs);
  const x = (value) => left + ((value - first) / (last - first)) * (right - left);
  const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
  context.strokeStyle = colours.faint;
  context.strokeRect(left, top, right - left, bottom - top);
  context.textAlign = "right";
  context.fillText(high.toPrecision(3), left - 3, top + 9);
  context.fillText(low.toPrecision(3), left - 3, bottom);
  context.fillText(`${last.toPrecision(3)} ${across}`, right, bottom + 14);
  context.textAlign = "left";
  context.fillText(first.toPrecision(2), left, bottom + 14);
  for (const level of levels) stroke([[first, level], [last, level]], [1, 3], colours.ink, 1);
  context.fillStyle = colours.edge;
  for (const [a, b] of points) context.fillRect(x(a) - 1.5, y(b) - 1.5, 3, 3);
  lines.forEach((line, index) => stroke(line.x.map((value, k) => [value, line.y[k]]), DASHES[line.dash ?? index] ?? [],
    line.faint ? colours.edge : index ? colours.second : colours.ink, line.wide ? 2.5 : 1.4));
  marks.forEach((mark, index) => {
    context.fillStyle = colours.ink;
    context.strokeStyle = colours.ink;
    context.beginPath();
    context.arc(x(mark.x), y(mark.y), 5, 0, 2 * Math.PI);
    if (mark.filled) context.fill();
    else context.stroke();
    context.fillText(mark.name, Math.min(x(mark.x) + 8, right - 60), y(mark.y) + (index % 2 ? 16 : -8));
  });
  function stroke(places, dash, colour, wide) {
    context.setLineDash(dash);
    context.strokeStyle = colour;
    context.lineWidth = wide;
    context.beginPath();
    places.forEach(([a, b], index) => context[index ? "lineTo" : "moveTo"](x(a), y(b)));
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = 1;
  }
}
