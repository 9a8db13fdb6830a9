// What the page knows: the last frame, the state of the cell, the own session, and a minute of trends of fixed size.

const ROWS = 1400;
const LATENCIES = 200;
export const SPAN = 60;
const OF_JOINTS = ["theta", "path", "predicted", "residual", "deviation", "volts"];
/** Columns of the trends of an arm of n joints. */
const columnsOf = (joints) => ["time", ...OF_JOINTS.flatMap((name) => numbers(joints).map((joint) => `${name}_${joint}`)), "evidence", "threshold"];
/** 1 to n. */
export const numbers = (joints) => Array.from({ length: joints }, (_, k) => k + 1);

/** Rows of numbers, of which the newest take the place of the oldest. */
export class Trends {
  constructor(joints = 3) {
    this.joints = joints;
    this.columns = columnsOf(joints);
    this.places = new Map(this.columns.map((name, index) => [name, index]));
    this.data = new Float64Array(ROWS * this.columns.length);
    this.first = 0;
    this.length = 0;
  }
  place(name) { return this.places.get(name); }
  clear() { this.first = this.length = 0; }
  value(row, column) {
    return this.data[((this.first + row) % ROWS) * this.columns.length + column];
  }
  get last() { return this.length ? this.value(this.length - 1, 0) : NaN; }
  add(values) {
    if (this.length && values[0] < this.last) this.clear();
    if (this.length && values[0] === this.last) return;
    const place = (this.first + this.length) % ROWS;
    this.data.set(values, place * this.columns.length);
    if (this.length < ROWS) this.length += 1;
    else this.first = (this.first + 1) % ROWS;
  }
}

const or = (value) => (value == null ? NaN : value);
function rowOf(frame) {
  const none = frame.theta.map(() => NaN);
  const of = (name) => (frame[name] ?? none).slice(0, none.length);
  return [frame.time, ...OF_JOINTS.flatMap(of), or(frame.evidence), or(frame.threshold)];
}

export const THREE = numbers(3).map((joint) => ({ name: `joint ${joint}`, turns: true, command: "V", lower: -Math.PI, upper: Math.PI, limit: 8 }));

class Store extends EventTarget {
  constructor() {
    super();
    this.live = { frame: null, state: null, trends: new Trends() };
    this.alarms = null;
    this.station = null;
    this.forgetStation();
    this.past = null;
    this.session = null;
    this.you = null;
    this.connected = false;
    this.received = 0;
    this.latencies = new Float32Array(LATENCIES);
    this.measured = 0;
  }
  /** What displays show: the past while it is looked at, the present otherwise. */
  get shown() { return this.past ?? this.live; }
  get frame() { return this.shown.frame; }
  get state() { return this.shown.state; }
  get trends() { return this.shown.trends; }
  /** The joints of another arm than the thesis's, or three that have no name. */
  get joints() {
    const faces = this.state?.joints;
    return faces?.length ? faces : THREE;
  }
  /** Age of the newest sample, s. */
  get age() {
    const frame = this.live.frame;
    if (!this.connected || !frame || frame.age == null) return Infinity;
    return frame.age + (performance.now() - this.received) / 1000;
  }
  get stale() { return this.past === null && this.age > (this.live.state?.line ? 2 : 1); }
  /** The arm of the station that is selected: its name, its last frame, and a minute of trends. */
  forgetStation() { this.station = { name: "", frame: null, trends: new Trends() }; }
  take(message) {
    if (message.tell === "frame") {
      this.live.frame = message;
      this.received = performance.now();
      if (message.theta && message.theta.length !== this.live.trends.joints) this.live.trends = new Trends(message.theta.length);
      if (message.theta) this.live.trends.add(rowOf(message));
    } else if (message.tell === "state") this.live.state = message;
    else if (message.tell === "alarms") this.alarms = message;
    else if (message.tell === "station") this.takeStation(message);
    else this.you = message;
    this.tell(message.tell);
  }
  takeStation({ name, frame }) {
    if (this.station.name !== name) this.forgetStation();
    Object.assign(this.station, { name, frame, received: performance.now() });
    if (frame.theta && frame.theta.length !== this.station.trends.joints) this.station.trends = new Trends(frame.theta.length);
    if (frame.theta) this.station.trends.add(rowOf(frame));
  }
  tell(kind) { this.dispatchEvent(new Event(kind)); }
  connect(connected) {
    if (connected === this.connected) return;
    this.connected = connected;
    this.tell("state");
    this.tell("frame");
  }
  show(past) {
    this.past = past;
    this.tell("state");
    this.tell("frame");
  }
  measure(latency) {
    this.latencies[this.measured % LATENCIES] = latency;
    this.measured += 1;
  }
  /** Median time from a sample to its pixels, ms. */
  get latency() {
    const count = Math.min(this.measured, LATENCIES);
    return count ? Array.from(this.latencies.subarray(0, count)).sort((a, b) => a - b)[count >> 1] : null;
  }
}

export const store = new Store();

/** Trends and frame from rows of the past. */
export function pastOf(told) {
  const index = Object.fromEntries(told.columns.map((name, place) => [name, place]));
  const joints = told.columns.filter((name) => name.startsWith("theta_")).length;
  const trends = new Trends(joints);
  for (const row of told.rows) trends.add(trends.columns.map((name) => or(row[index[name]])));
  const row = told.rows.at(-1);
  const of = (name) => numbers(joints).map((joint) => row[index[`${name}_${joint}`]]);
  const known = (values) => (values.some((value) => value == null) ? null : values);
  const frame = row && {
    time: row[index.time], at: row[index.at], age: 0, theta: of("theta"), path: known(of("path")),
    predicted: known(of("predicted")), residual: known(of("residual")), deviation: known(of("deviation")), volts: known(of("volts")),
    gripper: row[index.gripper], gripped: row[index.gripped] > 0, box: told.colours[row[index.box] ?? 0],
    evidence: row[index.evidence], threshold: row[index.threshold],
  };
  return { frame: frame ?? null, state: told.state, trends };
}
