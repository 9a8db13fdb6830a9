// Fields of forms, with their labels.
import { el } from "./dom.js";

let count = 0;

export function field(label, attributes, value) {
  const id = `f-${(count += 1)}`;
  const input = el("input", { id, ...attributes });
  input.value = value ?? "";
  return { label: el("label", { for: id }, label), input };
}

export function choice(label, names, chosen) {
  const id = `f-${(count += 1)}`;
  const input = el("select", { id });
  const offer = (offered) => {
    const before = input.value || chosen;
    input.replaceChildren(...offered.map(([value, words]) => el("option", { value }, words)));
    if (offered.some(([value]) => value === before)) input.value = before;
  };
  offer(names);
  return { label: el("label", { for: id }, label), input, offer };
}

/** Three numbers, one for each joint. */
export function triple(label, values) {
  const inputs = [0, 1, 2].map((k) => el("input", { type: "number", step: "any", min: 0, "aria-label": `${label}, joint ${k + 1}` }));
  const set = (given) => given.forEach((value, k) => { inputs[k].value = value; });
  if (values) set(values);
  return { label: el("span", {}, label), input: el("span", { class: "triple" }, ...inputs), set, get: () => inputs.map((input, k) => numberOf(input, `${label}, joint ${k + 1}`)) };
}

export function numberOf(input, name) {
  const value = Number(input.value);
  if (input.value.trim() === "" || !Number.isFinite(value)) throw new Error(`${name}: expected a number`);
  return value;
}

export const form = (...fields) => el("div", { class: "form" }, ...fields.flatMap(({ label, input }) => [label, input]));
