// Starts the page: session, stream, and the display that the address names.
import { forgetPalette } from "./canvas.js";
import { el } from "./dom.js";
import { findSession } from "./api.js";
import { follow } from "./stream.js";
import { store } from "./store.js";
import { makeHead, refreshAlarmLine } from "./head.js";
import { DISPLAYS } from "./displays/index.js";

const content = document.getElementById("content");
const navigation = document.getElementById("displays");
const alarmLine = document.getElementById("alarm-line");
let display = null;
let shownAs = "";
let drawing = false;
let madeFor = "[]";
const kindOf = () => (store.state?.joints?.length ? "any" : "thesis");

const refreshHead = makeHead(document.getElementById("head"));
const links = Object.entries(DISPLAYS).map(([name, { title }]) => el("a", { href: `#${name}` }, title));
navigation.replaceChildren(...links);

function open() {
  const asked = DISPLAYS[location.hash.slice(1)];
  const name = asked && (!asked.of || !store.state || asked.of === kindOf()) ? location.hash.slice(1) : "overview";
  if (name === shownAs) return;
  display?.close?.();
  shownAs = name;
  for (const link of links) link.toggleAttribute("aria-current", false);
  links[Object.keys(DISPLAYS).indexOf(name)].setAttribute("aria-current", "page");
  display = DISPLAYS[name].make();
  content.replaceChildren(display.node);
  content.dataset.display = name;
  refresh();
}

/** Displays are made for an arm: another one has others. */
function remade() {
  const arm = JSON.stringify(store.state?.joints?.map(({ name }) => name) ?? []);
  if (arm === madeFor) return;
  madeFor = arm;
  for (const [index, { of }] of Object.values(DISPLAYS).entries()) links[index].hidden = Boolean(of && of !== kindOf());
  shownAs = "";
  open();
}

function refresh() {
  remade();
  refreshHead();
  refreshAlarmLine(alarmLine);
  document.body.classList.toggle("stale", store.stale || (!store.connected && !store.past));
  display?.state?.();
  draw();
}

function draw() {
  if (drawing) return;
  drawing = true;
  requestAnimationFrame(() => {
    drawing = false;
    display?.draw?.();
    const frame = store.live.frame;
    if (frame?.heard && frame.heard !== draw.measured) {
      draw.measured = frame.heard;
      store.measure(performance.timeOrigin + performance.now() - frame.heard);
    }
  });
}

for (const kind of ["state", "you", "alarms"]) store.addEventListener(kind, refresh);
store.addEventListener("frame", draw);
window.addEventListener("hashchange", open);
window.addEventListener("resize", () => {
  forgetPalette();
  draw();
});
setInterval(() => {
  refreshHead();
  document.body.classList.toggle("stale", store.stale || (!store.connected && !store.past));
}, 500);

async function start() {
  try {
    await findSession();
    open();
    follow();
  } catch {
    setTimeout(start, 1000);
  }
}
start();
