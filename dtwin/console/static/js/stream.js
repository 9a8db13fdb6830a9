// The connection to the server: comes back by itself, and notices when nothing comes any more.
import { store } from "./store.js";
import { findSession } from "./api.js";

// A console that is up says something twenty times a second; to open a connection takes longer on a busy machine.
const SILENT = 1200;
const OPENING = 4000;
const LOOK = 200;
const FIRST = 300;
const LONGEST = 3000;
const SIGNS = 2000;
const said = { here: -Infinity, acted: -Infinity };
let socket = null;
let looksAt = "";
let heard = 0;
let delay = FIRST;

export function follow() {
  open();
  setInterval(() => {
    const patience = socket?.readyState === WebSocket.OPEN ? SILENT : OPENING;
    if (socket && performance.now() - heard > patience) {
      const old = socket;
      socket = null;
      old.close();
      lost();
    }
  }, LOOK);
  for (const sign of ["pointerdown", "keydown"]) document.addEventListener(sign, () => say("acted"));
}

/** Has the arm of a station of a line told, "" for none. */
export function look(station) {
  if (station === looksAt) return;
  looksAt = station;
  store.forgetStation();
  if (socket?.readyState === WebSocket.OPEN) socket.send(`look ${station}`);
}

// The page is alive as long as it takes what it is told, also behind other windows, where timers are slowed down.
function say(sign) {
  if (performance.now() - said[sign] < SIGNS || socket?.readyState !== WebSocket.OPEN) return;
  said[sign] = performance.now();
  socket.send(sign);
}

function open() {
  const made = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/stream`);
  socket = made;
  heard = performance.now();
  made.onopen = () => {
    heard = performance.now();
    if (looksAt) made.send(`look ${looksAt}`);
  };
  made.onmessage = (event) => {
    if (made !== socket) return;
    heard = performance.now();
    delay = FIRST;
    store.take(JSON.parse(event.data));
    store.connect(true);
    say("here");
  };
  made.onclose = () => {
    if (made !== socket) return;
    socket = null;
    lost();
  };
}

function lost() {
  store.connect(false);
  setTimeout(again, delay);
  delay = Math.min(2 * delay, LONGEST);
}

async function again() {
  try {
    await findSession();
  } catch {
    setTimeout(again, delay);
    return;
  }
  open();
}
