// A trend of the last minute: lines told apart by dash and by name, a band behind them.
import { begin } from "./canvas.js";
import { SPAN } from "./store.js";

const DASHES = [[], [6, 4], [2, 3], [9, 3, 2, 3], [4, 2], [1, 2], [12, 3]];

/**
 * lines: [{of: (row, value) => number, dash, colour}]; band: {low, high} of the same kind, or null;
 * range: [low, high], or null to fit, but at least from -least to least; levels: [{value, name}]
 */
export function drawTrend(canvas, trends, { title, unit, lines, band = null, range = null, levels = [], least = 0, span = SPAN }) {
  const drawing = begin(canvas);
  if (!drawing) return;
  const { context, width, height, colours } = drawing;
  const left = 46;
  const right = width - 6;
  const top = 16;
  const bottom = height - 14;
  context.fillStyle = colours.quiet;
  context.textAlign = "left";
  context.fillText(`${title}, ${unit}`, 4, 11);
  const end = trends.last;
  const begun = end - span;
  const rows = [];
  for (let row = 0; row < trends.length; row += 1) if (trends.value(row, 0) >= begun) rows.push(row);
  const value = (row) => (name) => trends.value(row, trends.place(name));
  let [low, high] = range ?? (least ? [-least, least] : [Infinity, -Infinity]);
  if (!range) {
    for (const row of rows) {
      for (const line of lines) {
        const found = line.of(value(row));
        if (Number.isFinite(found)) { low = Math.min(low, found); high = Math.max(high, found); }
      }
    }
    for (const level of levels) if (Number.isFinite(level.value)) { low = Math.min(low, level.value); high = Math.max(high, level.value); }
    if (!(high > low)) { low = (Number.isFinite(low) ? low : 0) - 1; high = low + 2; }
    const margin = 0.08 * (high - low);
    low -= margin;
    high += margin;
  }
  const x = (time) => left + ((time - begun) / span) * (right - left);
  const y = (found) => bottom - ((Math.max(low, Math.min(high, found)) - low) / (high - low)) * (bottom - top);
  if (band) {
    context.fillStyle = colours.band;
    context.beginPath();
    const usable = rows.filter((row) => Number.isFinite(band.low(value(row))));
    usable.forEach((row, index) => context[index ? "lineTo" : "moveTo"](x(trends.value(row, 0)), y(band.high(value(row)))));
    usable.reverse().forEach((row) => context.lineTo(x(trends.value(row, 0)), y(band.low(value(row)))));
    context.fill();
  }
  context.strokeStyle = colours.faint;
  context.strokeRect(left, top, right - left, bottom - top);
  context.fillStyle = colours.quiet;
  context.textAlign = "right";
  context.fillText(label(high), left - 3, top + 9);
  context.fillText(label(low), left - 3, bottom);
  for (const level of levels) {
    if (!Number.isFinite(level.value)) continue;
    context.setLineDash([1, 3]);
    context.strokeStyle = colours.ink;
    context.beginPath();
    context.moveTo(left, y(level.value));
    context.lineTo(right, y(level.value));
    context.stroke();
    context.setLineDash([]);
    context.fillText(level.name, right - 3, y(level.value) - 3);
  }
  lines.forEach((line, index) => {
    context.strokeStyle = colours[line.colour ?? (index ? "second" : "ink")];
    context.lineWidth = 1.5;
    context.setLineDash(DASHES[line.dash ?? index] ?? []);
    context.beginPath();
    let pen = false;
    for (const row of rows) {
      const found = line.of(value(row));
      if (!Number.isFinite(found)) { pen = false; continue; }
      context[pen ? "lineTo" : "moveTo"](x(trends.value(row, 0)), y(found));
      pen = true;
    }
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = 1;
  });
  context.textAlign = "left";
}

const label = (value) => (Math.abs(value) >= 100 ? value.toFixed(0) : Math.abs(value) >= 1 ? value.toFixed(1) : value.toPrecision(2));
