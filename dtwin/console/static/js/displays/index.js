// All displays, in the order of the navigation.
import { makeAlarms } from "./alarms.js";
import { makeIdentification } from "./identification.js";
import { makeModels } from "./models.js";
import { makeMonitoring } from "./monitoring.js";
import { makeOverview } from "./overview.js";
import { makeReplay } from "./replay.js";
import { makeSimulation } from "./simulation.js";
import { makeLine } from "../line/line.js";
import { makeStation } from "../line/station.js";
import { makeZone } from "../line/zone.js";
import { store } from "../store.js";

// `of` names what a display is for: the thesis's arm, any other one, or a line; without it, it is for all.
// `each` gives what can be selected on it, by the address that is shown.
export const DISPLAYS = {
  overview: { title: "Overview", make: makeOverview, of: ["thesis", "any"] },
  line: { title: "Line", make: makeLine, of: ["line"] },
  zone: { title: "Zone", make: makeZone, of: ["line"], each: () => (store.state?.line?.state?.zones ?? []).map(({ name }) => name) },
  station: { title: "Station", make: makeStation, of: ["line"], each: (shown) => (shown.startsWith("station/") ? [shown.slice(8)] : []) },
  identification: { title: "Identification", make: makeIdentification, of: ["thesis"] },
  models: { title: "Models", make: makeModels, of: ["any"] },
  monitoring: { title: "Monitoring", make: makeMonitoring, of: ["thesis", "any"] },
  simulation: { title: "Simulation", make: makeSimulation, of: ["thesis"] },
  alarms: { title: "Alarms", make: makeAlarms },
  replay: { title: "Replay", make: makeReplay, of: ["thesis", "any"] },
};
/** The display that is shown when the address names none. */
export const FIRST = { thesis: "overview", any: "overview", line: "line" };
