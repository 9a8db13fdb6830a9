// Starts the page: session, stream, and the display that the address names.
import { forgetPalette } from "./canvas.js";
import { el, rebuild } from "./dom.js";
import { findSession } from "./api.js";
import { follow, look } from "./stream.js";
import { store } from "./store.js";
import { makeHead, refreshAlarmLine } from "./head.js";
import { DISPLAYS, FIRST } from "./displays/index.js";

const content = document.getElementById("content");
const navigation = document.getElementById("displays");
const alarmLine = document.getElementById("alarm-line");
let display = null;
let shownAs = "";
let drawing = false;
const kindOf = () => (store.state?.line ? "line" : store.state?.joints?.length ? "any" : "thesis");
const armOf = () => JSON.stringify([kindOf(), store.state?.joints?.map(({ name }) => name) ?? []]);
let madeFor = armOf();

const refreshHead = makeHead(document.getElementById("head"));

/** The address of a display, and of what is selected on it: #zone/a. */
function asked() {
  const [name, ...rest] = decodeURIComponent(location.hash.slice(1)).split("/");
  const display = DISPLAYS[name];
  const here = display && (!display.of || !store.state || display.of.includes(kindOf()));
  return here && (!display.each || rest[0]) ? [name, display.each ? rest[0] : ""] : [FIRST[kindOf()], ""];
}

/** A link to each display, and to each zone of a line and the station that is selected. */
function refreshLinks() {
  const shown = Object.entries(DISPLAYS).filter(([, { of }]) => !of || of.includes(kindOf()));
  const found = shown.flatMap(([name, { title, each }]) => (each ? each(shownAs).map((one) => [`${name}/${one}`, `${title} ${one}`]) : [[name, title]]));
  const focused = document.activeElement?.closest?.("#displays a")?.getAttribute("href");
  rebuild(navigation, found, () => found.map(([address, title]) => el("a", { href: `#${address}` }, title)));
  for (const link of navigation.children) {
    const current = link.getAttribute("href") === `#${shownAs}`;
    if (current) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
    if (focused === link.getAttribute("href")) link.focus();
  }
}

function open() {
  const [name, selected] = asked();
  const address = selected ? `${name}/${selected}` : name;
  if (address === shownAs) return;
  display?.close?.();
  shownAs = address;
  display = DISPLAYS[name].make(selected);
  content.replaceChildren(display.node);
  content.dataset.display = name;
  look(name === "station" ? selected : "");
  refresh();
}

/** Displays are made for an arm or a line: another one has others. */
function remade() {
  if (armOf() === madeFor) return;
  madeFor = armOf();
  shownAs = "";
  open();
}

function refresh() {
  remade();
  refreshLinks();
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
for (const kind of ["frame", "station"]) store.addEventListener(kind, draw);
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
