// All displays, in the order of the navigation.
import { makeAlarms } from "./alarms.js";
import { makeIdentification } from "./identification.js";
import { makeModels } from "./models.js";
import { makeMonitoring } from "./monitoring.js";
import { makeOverview } from "./overview.js";
import { makeReplay } from "./replay.js";
import { makeSimulation } from "./simulation.js";

// `of` names the arms that a display is for, where it is not for all.
export const DISPLAYS = {
  overview: { title: "Overview", make: makeOverview },
  identification: { title: "Identification", make: makeIdentification, of: "thesis" },
  models: { title: "Models", make: makeModels, of: "any" },
  monitoring: { title: "Monitoring", make: makeMonitoring },
  simulation: { title: "Simulation", make: makeSimulation, of: "thesis" },
  alarms: { title: "Alarms", make: makeAlarms },
  replay: { title: "Replay", make: makeReplay },
};
