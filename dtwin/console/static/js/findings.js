// Two answers to what the monitor has found: I have seen it, and this is how the arm is from now on.
import { post } from "./api.js";
import { commandButton } from "./command.js";
import { store } from "./store.js";

const OF_MONITOR = ["finding/", "forecast/"];

/** The alarms of the monitor that wait for an operator. */
const waiting = () => (store.alarms?.alarms ?? []).filter((one) =>
  one.unacknowledged && !one.suppressed && one.shelved_until == null && OF_MONITOR.some((prefix) => one.name.startsWith(prefix)));

/** Silences the alarms of the findings; the monitor goes on reporting them. */
export const acknowledgeFindings = () => commandButton({
  name: "acknowledge", title: "Acknowledge the findings",
  reason: () => {
    if (store.past) return "not live: this is the past";
    if (!store.connected) return "no connection to the console";
    if (!waiting().length) return "no finding waits for an acknowledgement";
    return store.you?.yours ? "" : store.you?.desk ? `${store.you.desk} has the desk` : "occupy the desk first";
  },
  send: async () => {
    const seen = [];
    for (const { name } of waiting()) {
      const result = await post("/api/alarm/acknowledge", { name });
      if (!result.done) return result;
      seen.push(name.slice(name.indexOf("/") + 1).replace("/", ": "));
    }
    return { done: true, text: `acknowledged: ${seen.join(", ")}; the monitor still reports what it finds` };
  },
});

/** Has the monitor learn the arm as it is, faults and all. */
export const learnNormal = () => commandButton({ name: "learn", title: "Take as the new normal", confirm: consequence });

function consequence() {
  const { units = {}, forecasts = [] } = store.state?.verdict ?? {};
  const wrong = Object.values(units).filter((unit) => unit.state !== "nominal").map((unit) => unit.text || unit.state);
  const learnt = [...new Set([...wrong, ...forecasts])].join("; ");
  return `The monitor learns the arm as it is now and reports this no more: ${learnt}. `
    + "Nothing is repaired. Only a further change is found, measured from here, also if the arm comes back to what it was. "
    + "To say only that you have seen it, acknowledge the findings instead.";
}
