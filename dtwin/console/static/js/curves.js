// Curves against time or against each other, from arrays.
import { begin } from "./canvas.js";

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3], [4, 2], [1, 2]];

/**
 * lines: [{x: numbers, y: numbers, dash, faint, name}], marks: [{x, y, name, filled}], levels: numbers;
 * across: unit of the horizontal axis, which begins and ends with what is drawn; empty: words where there is nothing
 */
export function drawCurves(canvas, { title, unit, across, empty, lines = [], marks = [], levels = [], points = [] }) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const [left, right, top, bottom] = [52, width - 8, 18, height - 28];
  context.fillStyle = colours.quiet;
  context.fillText(`${title}, ${unit}`, 4, 12);
  const xs = [...lines.flatMap((line) => line.x), ...marks.map((mark) => mark.x), ...points.map((point) => point[0])];
  const ys = [...lines.flatMap((line) => line.y), ...marks.map((mark) => mark.y), ...points.map((point) => point[1]), ...levels];
  if (!xs.length) {
    context.fillText(empty, left, (top + bottom) / 2, right - left);
    return;
  }
  const range = (values, room) => {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    const margin = high > low ? room * (high - low) : 1;
    return [low - margin, high + margin];
  };
  const [low, high] = range(ys, 0.06);
  // Times are told as they are; marks of a search keep off the edges.
  const [first, last] = range(xs, marks.length ? 0.06 : 0);
  const x = (value) => left + ((value - first) / (last - first)) * (right - left);
  const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
  context.strokeStyle = colours.faint;
  context.strokeRect(left, top, right - left, bottom - top);
  context.textAlign = "right";
  context.fillText(high.toPrecision(3), left - 3, top + 9);
  context.fillText(low.toPrecision(3), left - 3, bottom);
  context.fillText(`${last.toPrecision(3)} ${across}`, right, bottom + 14);
  context.textAlign = "left";
  context.fillText(first === 0 ? "0" : first.toPrecision(2), left, bottom + 14);
  legend(context, colours, lines.filter((line) => line.name), context.measureText(`${title}, ${unit}`).width + 20, right);
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

/** The names of the lines, each after a piece of its dash, in what is left of the line of the title. */
function legend(context, colours, lines, from, to) {
  if (!lines.length) return;
  const share = Math.min(160, (to - from) / lines.length);
  lines.forEach((line, index) => {
    const x = from + index * share;
    context.setLineDash(DASHES[line.dash ?? index] ?? []);
    context.strokeStyle = index ? colours.second : colours.ink;
    context.lineWidth = 1.4;
    context.beginPath();
    context.moveTo(x, 8);
    context.lineTo(x + 26, 8);
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = 1;
    context.fillStyle = colours.quiet;
    context.fillText(line.name, x + 30, 12, Math.max(1, share - 36));
  });
}
