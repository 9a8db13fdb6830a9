// Elements made of texts alone: nothing that comes from outside is ever read as markup.

export function el(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value != null) made.setAttribute(key, value);
  }
  made.append(...children.filter((child) => child != null));
  return made;
}

/** Writes a text only where it differs, so that screen readers and layout are left alone. */
export function setText(node, text) {
  const wanted = String(text);
  if (node.textContent !== wanted) node.textContent = wanted;
}

/** Makes children anew only when what they are made of differs. */
export function rebuild(node, key, make) {
  // Nothing known is something to be told, too.
  const text = JSON.stringify(key ?? null);
  if (node.madeOf === text) return;
  node.madeOf = text;
  node.replaceChildren(...[make()].flat().filter((child) => child != null));
}

export function panel(title, width, ...children) {
  const id = `t-${title.toLowerCase().replace(/[^a-z0-9]+/g, "-")}`;
  return el("section", { class: `panel ${width}`, "aria-labelledby": id }, el("h2", { id }, title), ...children);
}

/** Panels under each other, beside other columns. */
export const column = (width, ...panels) => el("div", { class: `column ${width}` }, ...panels);

export function figures(rows) {
  return el("dl", { class: "figures" }, ...rows.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
}

/** A table, or the words that say why it is empty. */
export function table(caption, heads, rows, { numeric = [], empty }) {
  if (!rows.length) return el("p", { class: "why-not" }, empty);
  const cell = (tag, content, index, scope) =>
    el(tag, { class: numeric.includes(index) ? "number" : null, scope }, content);
  return el(
    "table", {},
    el("caption", {}, caption),
    el("thead", {}, el("tr", {}, ...heads.map((head, index) => cell("th", head, index, "col")))),
    el("tbody", {}, ...rows.map((row) => el("tr", {}, ...row.map((value, index) => cell("td", value, index))))),
  );
}

export const number = (value, digits = 3) => {
  const text = value == null ? "–" : Number(value).toFixed(digits);
  return /^-0\.?0*$/.test(text) ? text.slice(1) : text;
};
export const short = (value, digits = 4) => (value == null ? "–" : String(Number(Number(value).toPrecision(digits))));
export const each = (values, digits = 3) => (values == null ? "–" : values.map((v) => number(v, digits)).join("  "));
