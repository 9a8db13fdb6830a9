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

const refreshHead = makeHead(document.getElementById("head"));
const links = Object.entries(DISPLAYS).map(([name, { title }]) => el("a", { href: `#${name}` }, title));
navigation.replaceChildren(...links);

function open() {
  const name = location.hash.slice(1) in DISPLAYS ? location.hash.slice(1) : "overview";
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

function refresh() {
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
