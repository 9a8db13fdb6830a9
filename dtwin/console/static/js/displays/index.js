// All displays, in the order of the navigation.
import { makeAlarms } from "./alarms.js";
import { makeIdentification } from "./identification.js";
import { makeMonitoring } from "./monitoring.js";
import { makeOverview } from "./overview.js";
import { makeReplay } from "./replay.js";
import { makeSimulation } from "./simulation.js";

export const DISPLAYS = {
  overview: { title: "Overview", make: makeOverview },
  identification: { title: "Identification", make: makeIdentification },
  monitoring: { title: "Monitoring", make: makeMonitoring },
  simulation: { title: "Simulation", make: makeSimulation },
  alarms: { title: "Alarms", make: makeAlarms },
  replay: { title: "Replay", make: makeReplay },
};
