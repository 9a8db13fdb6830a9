// All displays, in the order of the navigation.
import { makeOverview } from "./overview.js";

export const DISPLAYS = {
  overview: { title: "Overview", make: makeOverview },
};
