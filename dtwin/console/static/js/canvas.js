// What all drawings share: sharp pixels, and the colours of the theme.

// Drawings are made in units of a fifteenth of the type's size, so that they grow with it.
const UNITS = 15;
let colours = null;
let unit = 0;

export function palette() {
  if (!colours) {
    const style = getComputedStyle(document.documentElement);
    const names = ["ground", "panel", "edge", "text", "quiet", "band", "ink", "faint", "second", "severe", "warn"];
    colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  return colours;
}

/** After a change of the theme or of the size of the window. */
export function forgetPalette() {
  colours = null;
  unit = 0;
}

/** The context of a canvas in units, which are CSS pixels at the smallest type, cleared; null while it is not seen. */
export function begin(canvas) {
  const [wide, high] = [canvas.clientWidth, canvas.clientHeight];
  if (!wide || !high) return null;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
    canvas.width = Math.round(wide * ratio);
    canvas.height = Math.round(high * ratio);
  }
  unit ||= parseFloat(getComputedStyle(document.documentElement).fontSize) / UNITS;
  const [width, height] = [wide / unit, high / unit];
  const context = canvas.getContext("2d");
  context.setTransform(ratio * unit, 0, 0, ratio * unit, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, sans-serif";
  return { context, width, height, colours: palette() };
}

/** A line through points, [x, y] each, in pixels. */
export function line(context, points, colour, width, dash) {
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

/** A disc with an edge, in pixels. */
export function disc(context, x, y, radius, fill, edge) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = edge;
  context.lineWidth = 2;
  context.stroke();
  context.lineWidth = 1;
}
