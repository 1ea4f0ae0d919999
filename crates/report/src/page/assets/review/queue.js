// The queue of scenarios: which ones are shown, and how many are decided.

import { data, decision } from "./decisions.js";

/** Candidates are `[number, category, filter that rejected it or null, whether it was chosen]`. */
const entries = data.scenarios;
const survives = (entry) => entry.candidates.some(([, , filter]) => !filter);
const is = (what) => (entry) => decision(entry.id)?.decision === what;
const isDecided = (entry) => is("pick")(entry) || is("reject")(entry);

/** Filters of the queue: key, label, predicate. */
export const STATES = [
  ["all", "all", () => true],
  ["todo", "to decide", (entry) => survives(entry) && !isDecided(entry)],
  ["pick", "accepted", is("pick")],
  ["reject", "rejected", is("reject")],
  ["flag", "flagged", is("flag")],
  ["none", "without survivors", (entry) => !survives(entry)],
];
export const CHOICES = ["all", "longitudinal", "lateral", "directional"].map((name) => [name, name]);

/** Filters that are selected. */
export const asked = { state: "all", category: "all" };

/** Categories of a scenario: of the accepted candidate, else the chosen one, else all survivors. */
function categories(entry) {
  const line = decision(entry.id);
  const picked = line?.decision === "pick" ? line.candidate : null;
  const one = entry.candidates.find((c) => c[0] === picked) ?? entry.candidates.find((c) => c[3]);
  return (one ? [one] : entry.candidates.filter((c) => !c[2])).map((c) => c[1]);
}

/** Whether a scenario is shown. */
export function shows(index) {
  const entry = entries[index];
  return STATES.find(([key]) => key === asked.state)[2](entry) &&
    (asked.category === "all" || categories(entry).includes(asked.category));
}

/** The next or previous shown scenario; null if there is none. */
export function step(index, direction) {
  for (let i = index + direction; i >= 0 && i < entries.length; i += direction) if (shows(i)) return i;
  return null;
}

/** Number of shown scenarios, in total and up to an index. */
export function count(index) {
  const shown = entries.map((_, i) => i).filter(shows);
  return { shown: shown.length, upTo: shown.filter((i) => i <= index).length };
}

/** Decisions by kind. */
export function tally() {
  const of = (what) => entries.filter(is(what)).length;
  return { pick: of("pick"), reject: of("reject"), flag: of("flag"), all: entries.length };
}
