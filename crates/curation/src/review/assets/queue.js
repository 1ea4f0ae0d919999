// The queue of scenarios: which ones are shown, and how many are decided.

import { CATEGORIES } from "./decode.js";

/** Unpacks the scenario list of the session. */
export function entries(overview) {
  return overview.scenarios.map((scenario) => {
    const candidates = [];
    for (let i = 0; i + 3 < scenario.candidates.length; i += 4) {
      const [number, category, filter, chosen] = scenario.candidates.slice(i, i + 4);
      candidates.push({
        number,
        category: CATEGORIES[category],
        filter: filter < 0 ? null : overview.filters[filter],
        chosen: chosen === 1,
      });
    }
    return { id: scenario.id, candidates };
  });
}

const decision = (standing) => standing?.verdict?.decision ?? null;
const survives = (entry) => entry.candidates.some((c) => !c.filter);

/** Returns the filters of the queue: key, label, predicate. `reviewer` returns the current reviewer. */
function states(filters, reviewer) {
  const is = (what) => (entry, standing) => decision(standing) === what;
  return [
    ["all", "all", () => true],
    ["todo", "to decide",
      (entry, standing) => survives(entry) && !["pick", "reject"].includes(decision(standing))],
    ["undecided", "undecided", (entry, standing) => !decision(standing)],
    ["mine", "undecided by you",
      (entry, standing) => !standing?.opinions.some((line) => line.reviewer === reviewer())],
    ["pick", "picked", is("pick")],
    ["reject", "rejected", is("reject")],
    ["flag", "flagged", is("flag")],
    ["disagree", "reviewers disagree", (entry, standing) => !!standing?.disagree],
    ["chosen", "with a chosen candidate", (entry) => entry.candidates.some((c) => c.chosen)],
    ["none", "without survivors", (entry) => !survives(entry)],
    ...filters.map((name) =>
      [`filter:${name}`, `rejected by ${name}`, (entry) => entry.candidates.some((c) => c.filter === name)]),
  ];
}

/** Returns the categories of a scenario: of the picked candidate, else the chosen one, else all survivors. */
function categories(entry, standing) {
  const picked = decision(standing) === "pick" ? standing.verdict.candidate : null;
  const one = entry.candidates.find((c) => c.number === picked) ?? entry.candidates.find((c) => c.chosen);
  return one ? [one.category] : entry.candidates.filter((c) => !c.filter).map((c) => c.category);
}

export class Queue {
  state = "all";
  category = "all";
  reviewer = null;

  constructor(overview, standings) {
    this.entries = entries(overview);
    this.states = states(overview.filters, () => this.reviewer);
    this.standings = new Map(standings.map((s) => [s.index, s]));
  }

  /** Returns whether a scenario is shown. */
  shows(index) {
    const [entry, standing] = [this.entries[index], this.standings.get(index)];
    const test = this.states.find(([key]) => key === this.state)[2];
    return test(entry, standing) &&
      (this.category === "all" || categories(entry, standing).includes(this.category));
  }

  /** Returns the next or previous shown scenario; null if there is none. */
  step(index, direction) {
    for (let i = index + direction; i >= 0 && i < this.entries.length; i += direction) {
      if (this.shows(i)) return i;
    }
    return null;
  }

  /** Returns the number of shown scenarios, in total and up to an index. */
  count(index) {
    let [shown, upTo] = [0, 0];
    for (let i = 0; i < this.entries.length; i++) {
      if (!this.shows(i)) continue;
      shown++;
      if (i <= index) upTo++;
    }
    return { shown, upTo };
  }

  /** Counts the decisions of all scenarios by kind. */
  tally() {
    const tally = { pick: 0, reject: 0, flag: 0, disagree: 0, all: this.entries.length };
    for (const standing of this.standings.values()) {
      const what = decision(standing);
      if (what) tally[what]++;
      if (standing.disagree) tally.disagree++;
    }
    return tally;
  }

  set(standing) {
    if (standing.opinions.length) this.standings.set(standing.index, standing);
    else this.standings.delete(standing.index);
  }
}
