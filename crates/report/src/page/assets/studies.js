// Studies: replan interval, protocols, ablations, planners, errors, values of axes.

import { data, metric, runs } from "./data.js";
import { $, el } from "./dom.js";
import { count, half, interval, number, titled } from "./format.js";

const ABOUT = {
  replan: ["Effect of the replan interval", "Columns: replan interval."],
  realism: ["Realism and reactive protocols", "In the realism protocol the simulator also moves the AV, and is compared with the log."],
  guards: ["Ablation", "The same simulators with parts removed or added, and with the AV's next step visible or not."],
  planners: ["Planners", "Columns: planner of the AV. Rows: simulator of the other agents."],
  errors: ["Displacements from the log", "Means over agents, with 95 % intervals over scenarios. Ahead is the mean offset along the logged heading, aside the mean distance across it. An agent belongs to the first of these situations that applies: stands, sets off, turns, halts, follows, crosses, drives freely."],
  axes: ["Values of settings", "Rows: simulator and its settings."],
};

/** Properties by which the study of errors groups agents. */
const PROPERTIES = {
  all: "All agents", class: "By class", situation: "By what agents do in the log", speed: "By speed at the current frame",
  distance: "By distance from the AV at the current frame", time: "By time",
};

const arrow = (m) => `${titled(m)} ${m.lower_is_better ? "↓" : "↑"}`;
const TEXTS = ["Method", "Planners", "Variant", "Settings", "Agents"];
const head = (...names) => el("thead", {}, el("tr", {}, ...names.map((n) => el("th", { scope: "col", class: TEXTS.includes(n) ? null : "number" }, n))));
const method = (s) => el("th", { scope: "row" }, s.title, s.mark ? el("abbr", { title: s.meaning }, ` ${s.mark}`) : null);

function cell(m, estimate) {
  if (!estimate || estimate.mean === null) return el("td", { class: "number" }, "–");
  return el("td", { class: "number", "data-metric": m.id, "data-mean": estimate.mean, title: `${interval(m, estimate)}, ${count(estimate.scenarios, "scenario")}` },
    number(m, estimate.mean), el("small", {}, half(m, estimate)));
}

/** A difference; bold if its interval excludes 0. */
function difference(m, w) {
  if (!w || w.mean === null) return el("td", { class: "number" }, "–");
  const text = `${w.mean > 0 ? "+" : w.mean < 0 ? "−" : ""}${number(m, Math.abs(w.mean))}`;
  const isSure = w.low !== null && (w.low > 0 || w.high < 0);
  return el("td", { class: "number", "data-metric": m.id, "data-mean": w.mean, title: `${interval(m, w)}, p = ${w.p.toFixed(4)}` }, isSure ? el("strong", {}, text) : text);
}

const find = (member, id) => member.simulators.find((s) => s.id === id);
const wide = (...rows) => el("div", { class: "wide", tabindex: "0", role: "region", "aria-label": "Study, scrollable" }, el("table", { class: "data" }, ...rows));

/** One table per metric with a value: simulators by replan interval. */
function replan({ members }) {
  const columns = data.metrics.filter((m) => members.some((member) => member.simulators.some((s) => (s.metrics[m.id]?.mean ?? null) !== null)));
  // Those of the AV first.
  columns.sort((a, b) => (b.av ?? false) - (a.av ?? false));
  return columns.flatMap((m) => [
    el("h4", {}, arrow(m)),
    wide(head("Method", ...members.map((member) => member.label)), el("tbody", {}, ...members[0].simulators.map((s) => el("tr", {}, method(s), ...members.map((member) => cell(m, find(member, s.id)?.metrics[m.id])))))),
  ]);
}

/** One table: simulators by metrics of all members, with the protocol where members differ in it; below it the metrics of the Sim Agents challenge, if there are any. */
function realism({ members, realism: scores = [] }) {
  const columns = members.flatMap((member) => Object.keys(member.simulators[0]?.metrics ?? {}).map((id) => [member, metric(id)]));
  columns.sort((a, b) => members.indexOf(a[0]) - members.indexOf(b[0]) || data.metrics.indexOf(a[1]) - data.metrics.indexOf(b[1]));
  const protocols = wide(head("Method", ...columns.map(([member, m]) => (member.protocol ? `${member.protocol}: ${arrow(m)}` : arrow(m)))),
    el("tbody", {}, ...members[0].simulators.map((s) => el("tr", {}, method(s), ...columns.map(([member, m]) => cell(m, find(member, s.id)?.metrics[m.id]))))));
  if (!scores.length) return [protocols];
  return [protocols, el("h4", {}, `Realism metrics of the Sim Agents challenge ${scores[0].config}`),
    wide(head("Method", ...data.aggregates.map(arrow)),
      el("tbody", {}, ...scores.map((s) => el("tr", {}, method(find(members[0], s.id) ?? s), ...data.aggregates.map((m) => cell(m, s.aggregates[m.id]))))))];
}

/** Two tables: values of all variants, and their differences from the unchanged simulators. */
function guards({ members }) {
  const columns = data.metrics.filter((m) => members.some((member) => member.simulators.some((s) => s.metrics[m.id])));
  const rows = members[0].simulators.flatMap((original) => members.flatMap((member) =>
    Object.entries(member.originals).filter(([, of]) => of === original.id).map(([id]) => [original, member, find(member, id)])).filter(([, , s]) => s));
  const table = (name, part, all) => [el("h4", {}, name), wide(head("Method", "Variant", ...columns.map(arrow)),
    el("tbody", {}, ...all.map(([original, member, s]) => el("tr", {}, method(original), el("td", {}, member.label), ...columns.map((m) => part(m, s))))))];
  return [
    ...table("Values", (m, s) => cell(m, s.metrics[m.id]), rows),
    ...table("Difference from the unchanged simulator (bold if the interval excludes 0)", (m, s) => difference(m, s.difference[m.id]), rows.filter(([, , s]) => s.difference)),
  ];
}

const plain = (names, rows) => wide(head(...names), el("tbody", {}, ...rows.map(([first, ...rest]) =>
  el("tr", {}, el("th", { scope: "row" }, first), ...rest.map((text) => el("td", { class: "number" }, text ?? "–"))))));

/** A link to a scenario with the same simulator around two planners, side by side. */
function compared({ planners, scenario }, simulator, members) {
  const side = (planner) => {
    const { folder } = members.find((member) => member.planner === planner);
    const run = runs.find(({ name }) => name === folder || name.endsWith(`/${folder}`));
    return run ? `${simulator}@${run.name}` : "";
  };
  const [left, right] = planners.map(side);
  return el("a", { href: `#${new URLSearchParams({ scenario, left, right })}` }, `${planners.join(" and ")} among ${simulator}`);
}

/** A difference with its interval and p-value; `about` says of what it is. */
function paired(m, w, about = "") {
  const shown = difference(m, w);
  if (!w || w.mean === null) return shown;
  const range = w.low === null ? "" : ` ${number(m, w.low)} to ${number(m, w.high)},`;
  shown.append(el("small", {}, `${range} p ${w.p < 0.0001 ? "< 0.0001" : w.p.toFixed(4)}${about}`));
  return shown;
}

/** Every two planners: the difference of their scores under each simulator, and its largest change between two. */
function pairs({ members, planner_pairs: all = [], planners: found }) {
  if (!found || !all.length) return [];
  const { score, simulators } = found;
  const m = metric(score);
  const title = (id) => members.map((member) => find(member, id)).find((s) => s)?.title ?? id;
  const between = (change) => change && `, from ${title(change.simulators[0])} to ${title(change.simulators[1])}`;
  return [
    el("h3", {}, `Difference of ${m.title} between two planners, by traffic model`),
    wide(head("Planners", ...simulators.map((s) => title(s.id)), "Largest change"), el("tbody", {}, ...all.map(({ planners: [first, second], differences, dependence }) =>
      el("tr", {}, el("th", { scope: "row" }, `${second} minus ${first}`), ...differences.map((w) => paired(m, w)), paired(m, dependence, between(dependence)))))),
    el("p", { class: "dim small" }, "Paired, scenario by scenario, with 95 % intervals; p by a permutation test of the signs. Bold if the interval excludes 0. The p-value of the largest change is times the number of pairs of traffic models."),
  ];
}

/** Scores by planner, ranks, agreement of simulators, and reasons of collisions. */
function planners(numbers) {
  const { members, planners: found } = numbers;
  const planned = members.filter((member) => member.planner);
  const title = (id) => find(planned[0], id)?.title ?? id;
  const fixed = members.filter((member) => !member.planner);
  const [scores, others] = [planned, fixed].map((some) => (some.length ? replan({ members: some }) : []));
  if (!found) return [...scores, ...others];
  const two = (v) => v?.toFixed(2);
  const change = found.change;
  return [
    ...scores,
    el("h4", {}, "Rank by the score, 1 is best"),
    plain(["Method", ...found.planners], found.simulators.map((s) => [title(s.id), ...s.ranks.map(String)])),
    el("h4", {}, "Kendall's tau of the order of planners between two simulators"),
    plain(["Method", "and", "Tau", "95 % interval"], found.agreement.map((a) => [title(a.first), title(a.second), two(a.tau), a.low === null ? null : `${two(a.low)} to ${two(a.high)}`])),
    el("h4", {}, "Collisions that the AV causes, over all planners but the log"),
    plain(["Method", "At fault", "Agents ignored the AV", "None, as agents were frozen"], found.simulators.map((s) => [title(s.id), s.at_fault, s.ignored, s.frozen])),
    change ? el("p", {}, `The difference of ${change.planners.join(" and ")} depends most on the simulator: ${change.differences.map((d, i) => `${d.toFixed(3)} among ${title(change.simulators[i])}`).join(", ")}. It changes most in scenario ${change.scenario}: `,
      compared(change, change.simulators[0], planned), ", ", compared(change, change.simulators[1], planned), ".") : null,
    ...others,
  ].filter((part) => part !== null);
}

/** The table of the run, and displacements by each property of the agents. */
function errors({ members, errors: found }) {
  const run = realism({ members });
  if (!found) return run;
  const metres = (v) => el("td", { class: "number" }, v.toFixed(2));
  const row = (s, g) => el("tr", {}, method(find(members[0], s.id) ?? { title: s.id }), el("td", {}, g.group), el("td", { class: "number" }, g.agents),
    el("td", { class: "number", "data-mean": g.displacement }, g.displacement.toFixed(2), el("small", {}, g.low === null ? null : ` ${g.low.toFixed(2)} to ${g.high.toFixed(2)}`)),
    metres(g.ahead), metres(g.aside), el("td", { class: "number" }, g.share === null ? "–" : `${(100 * g.share).toFixed(0)} %`));
  return [...run, ...Object.entries(PROPERTIES).flatMap(([property, title]) => {
    const rows = found.simulators.flatMap((s) => s.groups.filter(({ by }) => by === property).map((g) => row(s, g)));
    return rows.length ? [el("h4", {}, title), wide(head("Method", "Agents", "Number", "Displacement (m)", "Ahead (m)", "Aside (m)", "Share"), el("tbody", {}, ...rows))] : [];
  })];
}

/** One table: the metrics of every simulator at the values of the axes. */
function axes({ members }) {
  const columns = data.metrics.filter((m) => members.some((member) => member.simulators.some((s) => s.metrics[m.id])));
  const ids = [...new Set(members.flatMap((member) => member.simulators.map((s) => s.id)))];
  const rows = ids.flatMap((id) => members.map((member) => [member, find(member, id)])).filter(([, s]) => s);
  return [wide(head("Method", "Settings", ...columns.map(arrow)),
    el("tbody", {}, ...rows.map(([member, s]) => el("tr", {}, method(s), el("td", {}, member.label), ...columns.map((m) => cell(m, s.metrics[m.id]))))))];
}

/** Shows the tables of all studies; the differences of planners are the first results. */
export function studies() {
  const draw = { replan, realism, guards, planners, errors, axes };
  $("studies").hidden = $("nav-studies").hidden = !data.studies.length;
  $("pairs").replaceChildren(...data.studies.flatMap(({ numbers }) => (numbers.study === "planners" ? pairs(numbers) : [])));
  $("studies-body").replaceChildren(...data.studies.map(({ name, numbers }) => {
    const [title, about] = ABOUT[numbers.study];
    return el("section", { "data-study": numbers.study }, el("h3", {}, `${title} (${name})`), el("p", { class: "dim small" }, about), ...draw[numbers.study](numbers));
  }));
}
