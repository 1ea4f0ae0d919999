// The numbers of the page.

import { $ } from "./dom.js";

/** What the program wrote (src/report/page/data.rs). */
export const data = JSON.parse($("data").textContent);
export const runs = data.runs;
export const scenarios = data.scenarios;
export const metrics = data.metrics;

const place = new Map(metrics.map((m, i) => [m.id, i]));
const several = runs.length > 1;

/** Simulators of runs, each with its name and what the summary says of it. */
export const subjects = data.subjects.map((s, i) => ({
  ...s,
  index: i,
  name: `${s.title}${s.oracle ? " †" : ""}${several ? ` · ${runs[s.run].name}` : ""}`,
  summary: runs[s.run].summary.simulators[s.id],
  settings: runs[s.run].summary.provenance.settings,
}));

/** A metric by its id. */
export const metric = (id) => metrics[place.get(id)];

/** Value of a subject and a metric in a scenario; null where there is none. */
export const value = (subject, id, scenario) => scenarios.values[subject][place.get(id)][scenario] ?? null;

/** How many events of a metric count for a subject in a scenario. */
export const counted = (subject, id, scenario) => scenarios.events[subject][place.get(id)][scenario] ?? 0;

/** The names of what ways of deviating there are, in their usual order. */
export const categories = ["longitudinal", "lateral", "directional", ...new Set(scenarios.category.filter(Boolean))]
  .filter((c, i, all) => all.indexOf(c) === i && scenarios.category.includes(c));

/** The grades of difficulty that there are, the easiest first. */
export const difficulties = ["easy", "medium", "hard"].filter((d) => scenarios.difficulty.includes(d));
