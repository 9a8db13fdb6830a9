// The connection to the server: comes back by itself, and notices when nothing comes any more.
import { store } from "./store.js";
import { findSession } from "./api.js";

// A console that is up says something twenty times a second; to open a connection takes longer on a busy machine.
const SILENT = 1200;
const OPENING = 4000;
const LOOK = 200;
const FIRST = 300;
const LONGEST = 3000;
let socket = null;
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
  let told = 0;
  for (const sign of ["pointerdown", "keydown"]) {
    document.addEventListener(sign, () => {
      if (performance.now() - told < 5000 || socket?.readyState !== WebSocket.OPEN) return;
      told = performance.now();
      socket.send("here");
    });
  }
}

function open() {
  const made = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/stream`);
  socket = made;
  heard = performance.now();
  made.onopen = () => { heard = performance.now(); };
  made.onmessage = (event) => {
    if (made !== socket) return;
    heard = performance.now();
    delay = FIRST;
    store.take(JSON.parse(event.data));
    store.connect(true);
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
