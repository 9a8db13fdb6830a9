// Stands for the connection to a console: a minute of frames at once, and then twenty a second.
window.WebSocket = class {
  static OPEN = 1;
  constructor() {
    this.readyState = 1;
    setTimeout(() => this.begin());
  }
  begin() {
    this.onopen?.();
    const { you, state, alarms, frame, rows } = window.MADE_UP;
    for (const message of [you, state, alarms]) this.tell(message);
    let count = 0;
    const next = () => {
      const time = 0.05 * count;
      const sway = (k, rate) => Math.sin(rate * time + k);
      const path = frame.path.map((value, k) => value + 0.4 * sway(k, 0.7));
      const theta = frame.theta.map((value, k) => value + 0.4 * sway(k, 0.7) + 0.008 * sway(k, 3));
      const residual = frame.residual.map((value, k) => value * sway(k, 11));
      const predicted = theta.map((value, k) => value - residual[k]);
      this.tell({ ...frame, time, theta, path, residual, predicted, age: 0, heard: Date.now() });
      count += 1;
    };
    while (count < rows) next();
    this.beat = setInterval(next, 50);
  }
  tell(message) { this.onmessage?.({ data: JSON.stringify(message) }); }
  send() {}
  close() { clearInterval(this.beat); }
};
