// The data of the page.

import { $ } from "./dom.js";

/** Data written by src/report/page/data.rs. */
export const data = JSON.parse($("data").textContent);
export const runs = data.runs;
export const scenarios = data.scenarios;
export const metrics = data.metrics;

const place = new Map(metrics.map((m, i) => [m.id, i]));
const several = runs.length > 1;

/** Simulators of runs, each with its name, summary and settings. */
export const subjects = data.subjects.map((s, i) => ({
  ...s,
  index: i,
  name: `${s.title}${s.mark && ` ${s.mark}`}${several ? ` · ${runs[s.run].name}` : ""}`,
  summary: runs[s.run].summary.simulators[s.id],
  settings: runs[s.run].summary.provenance.settings,
  planner: /^planner:(.*)/.exec(runs[s.run].summary.provenance.settings.av)?.[1] ?? null,
}));

/** Metric with this id. */
export const metric = (id) => metrics[place.get(id)];

/** Ids of the metrics that the benchmark does not have. */
export const ownMetrics = metrics.filter((m) => m.own).map((m) => m.id);

/** Ids of the metrics of the AV; none if no planner drives. */
export const avMetrics = data.av_columns;

/** Whether a subject has a value of a metric in some scenario. */
export const hasValues = (subject, id) => scenarios.values[subject][place.get(id)].length > 0;

const filled = (id) => subjects.reduce((n, s) => n + scenarios.values[s.index][place.get(id)].filter((v) => v !== null).length, 0);

/** Id of the first metric of the AV that most scenarios have; undefined if no planner drives. */
export const verdict = [...avMetrics].sort((a, b) => filled(b) - filled(a))[0];

/** Value of a metric for a subject in a scenario; null if there is none. */
export const value = (subject, id, scenario) => scenarios.values[subject][place.get(id)][scenario] ?? null;

/** Score of the AV for a subject in a scenario, complete or partial; null if there is none. */
export const score = (subject, scenario) => value(subject, "av-score", scenario) ?? value(subject, "av-score-partial", scenario);

/** Number of counted events of a metric for a subject in a scenario. */
export const counted = (subject, id, scenario) => scenarios.events[subject][place.get(id)][scenario] ?? 0;

/** Categories of deviation that occur, in their usual order. */
export const categories = ["longitudinal", "lateral", "directional", ...new Set(scenarios.category.filter(Boolean))]
  .filter((c, i, all) => all.indexOf(c) === i && scenarios.category.includes(c));

/** Difficulties that occur, from easy to hard. */
export const difficulties = ["easy", "medium", "hard"].filter((d) => scenarios.difficulty.includes(d));
