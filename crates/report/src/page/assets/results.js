// The main table, the tables of categories and difficulties, and events per scenario.

import { avMetrics, categories, counted, data, difficulties, metric, metrics, ownMetrics, runs, scenarios, subjects } from "./data.js";
import { $, el } from "./dom.js";
import { count, half, interval, number, titled } from "./format.js";

const several = runs.length > 1;
/** Explanations of the marks behind names of simulators. */
const marks = [...new Set(subjects.filter((s) => s.mark).map((s) => ` ${s.mark} ${s.meaning}.`))].join("");
/** Metrics in the table of events, in the order of the columns. */
const hasEvents = (id) => scenarios.events.some((of) => of[metrics.findIndex((m) => m.id === id)].length);
const EVENT_METRICS = [...avMetrics.filter(hasEvents), "aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "acceleration", "curvature", "red-light", ...ownMetrics.filter(hasEvents)];
/** What drives the AV of a subject. */
const avOf = (s) => s.planner ?? s.settings.av;
/** Planners in the order of their runs, simulators in that of the tables. */
const planners = [...new Set(subjects.filter((s) => s.planner).map((s) => s.planner))], traffic = [...new Set(subjects.map((s) => s.id))];

/** Which subjects of a table are ranked, and among which others: simulators in comparable runs; planners in the same traffic. */
const SIMULATORS = { is: (s) => !s.oracle, group: (s) => runs[s.run].group };
const PLANNERS = { is: () => true, group: (s) => JSON.stringify([s.id, runs[s.run].summary.provenance.scenarios_blake3, { ...s.settings, av: null }]) };

/** Parts of the scenarios with a table: the estimates of a subject, and whether a scenario of a run belongs to it. */
const PARTS = [
  { name: "all", label: "all scenarios", of: (summary) => summary, has: () => true },
  ...categories.map((c) => ({ name: c, label: c, of: (summary) => summary?.by_category[c], has: (run, i) => scenarios.categories[run][i] === c })),
  ...difficulties.map((d) => ({ name: d, label: d, of: (summary) => summary?.by_difficulty?.[d], has: (run, i) => scenarios.difficulties[run][i] === d })),
];

/** Number of scenarios of a part: that of the run with most of them. */
const size = (part) => Math.max(...runs.map((_, run) => scenarios.id.filter((_, i) => part.has(run, i)).length));

let part = PARTS[0];
let sorted = { by: null, down: false };
let onChange = () => {};
const isOneGroup = new Set(runs.map((r) => r.group)).size === 1;
/** Whether the table has every metric with a value, not only the usual columns. */
let isWhole = false;

/** Estimates of a subject in the chosen part. */
const estimates = (subject) => part.of(subject.summary);

/** Metrics of the table. */
function tableMetrics() {
  const extra = metrics.map((m) => m.id).filter((id) => !data.columns.includes(id) && !metric(id).av && subjects.some((s) => (s.summary?.metrics[id]?.mean ?? null) !== null));
  return [...data.columns, ...(isWhole ? extra : [])].map(metric);
}

/** The best number of each group of ranked rows; as printed, so that equal numbers tie. */
function best(rows, column, ranked) {
  const groups = Map.groupBy(rows.filter(ranked.is), ranked.group);
  return new Map([...groups].map(([group, members]) => {
    const shown = members.map((r) => estimates(r)?.metrics[column.id]?.mean).filter((v) => v !== null && v !== undefined);
    return [group, shown.length < 2 ? null : number(column, column.lower_is_better ? Math.min(...shown) : Math.max(...shown))];
  }));
}

function cell(subject, column, top, ranked) {
  const estimate = estimates(subject)?.metrics[column.id];
  const about = { class: "number", "data-metric": column.id };
  if (!estimate || estimate.mean === null) return el("td", { ...about, title: "no scenario has a value" }, "–");
  const { mean } = estimate;
  const text = number(column, mean);
  const isBest = ranked.is(subject) && text === top.get(ranked.group(subject));
  return el(
    "td",
    { ...about, "data-mean": mean, title: `${text}, ${interval(column, estimate)}, ${count(estimate.scenarios, "scenario")}` },
    isBest ? el("strong", {}, text) : text,
    el("small", {}, half(column, estimate)),
  );
}

function head(table, label, key, numeric, about) {
  const isBy = sorted.by === key;
  const turn = () => {
    sorted = { by: key, down: isBy ? !sorted.down : false };
    show();
    // The table was rebuilt: restore the keyboard focus.
    $(table).querySelector(`button[data-key="${key}"]`)?.focus();
  };
  return el(
    "th",
    { scope: "col", class: numeric ? "number" : null, "aria-sort": isBy ? (sorted.down ? "descending" : "ascending") : "none" },
    el("button", { class: "sort", title: about, "data-key": key, onclick: turn }, label, el("span", { "aria-hidden": "true" }, isBy ? (sorted.down ? " ▾" : " ▴") : "")),
  );
}

/** Fills a table with rows of subjects. */
function fill(table, rows, columns, ranked) {
  if (sorted.by !== null) {
    const key = (s) => (sorted.by === "name" ? s.name : sorted.by === "run" ? runs[s.run].name : sorted.by === "av" ? avOf(s) : estimates(s).metrics[sorted.by]?.mean ?? Infinity);
    const sign = sorted.down ? -1 : 1;
    rows.sort((a, b) => sign * (key(a) < key(b) ? -1 : key(a) > key(b) ? 1 : 0));
  }
  const tops = columns.map((c) => best(rows, c, ranked));
  const failed = part === PARTS[0] && rows.some((s) => s.summary.failed > 0);
  $(table).replaceChildren(
    el("thead", {}, el("tr", {},
      several ? head(table, "Run", "run") : null,
      avMetrics.length ? head(table, "AV", "av") : null,
      head(table, avMetrics.length ? "Traffic" : "Method", "name"),
      ...columns.map((c) => head(table, el("span", {}, `${c.title} `, el("span", { class: "unit" }, `${titled(c).slice(c.title.length)} ${c.lower_is_better ? "↓" : "↑"}`.trim())), c.id, true, `${c.id} · ${c.source}`)),
      failed ? el("th", { scope: "col", class: "number" }, "Failed") : null)),
    el("tbody", {}, ...rows.map((s) => el("tr", { "data-subject": s.index },
      several ? el("td", {}, runs[s.run].name) : null,
      avMetrics.length ? el("td", {}, avOf(s)) : null,
      el("th", { scope: "row" }, s.title, s.mark ? el("abbr", { title: s.meaning }, ` ${s.mark}`) : null),
      ...columns.map((c, i) => cell(s, c, tops[i], ranked)),
      failed ? el("td", { class: "number" }, String(s.summary.failed)) : null))),
  );
}

function show() {
  const rows = subjects.filter((s) => estimates(s));
  $("av").hidden = !avMetrics.length;
  if (avMetrics.length) {
    // Planners in the same traffic stand next to each other.
    const judged = rows.filter((s) => s.planner).sort((a, b) => traffic.indexOf(a.id) - traffic.indexOf(b.id));
    fill("av-table", judged, avMetrics.map(metric), PLANNERS);
    $("av-about").textContent = `Driven by ${planners.join(", ")}; judged by nuPlan's closed-loop metrics.${planners.length > 1 ? " Bold: best planner in the same traffic." : ""}`;
  }
  fill("main-table", rows, tableMetrics(), SIMULATORS);
  for (const tab of $("parts").children) tab.setAttribute("aria-pressed", String(tab.dataset.part === part.name));
  $("main-about").textContent = `${count(size(part), "scenario")}. Means with half widths of 95 % bootstrap intervals over scenarios; ↓ less is better, ↑ more is. Bold: best simulator other than oracles${isOneGroup ? "" : " among runs on the same scenarios with the same AV and settings"}.${marks}${data.fewer[part.name] ? ` ${data.fewer[part.name]}.` : ""}`;
  eventTable();
  paperTable();
  onChange();
}

/** The paper's rows, each number as printed, and below them those of the runs on all scenarios. */
function paperTable() {
  const { paper } = data;
  $("paper").hidden = !paper;
  if (!paper) return;
  const shown = paper.metrics.map(metric);
  const own = (s) => shown.map((c) => s.summary.metrics[c.id]?.mean ?? null).map((mean, i) => (mean === null ? "–" : number(shown[i], mean)));
  const row = (source, name, values) => el("tr", {}, el("td", {}, source), el("th", { scope: "row" }, name), ...values.map((v) => el("td", { class: "number" }, v)));
  $("paper-table").replaceChildren(
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Source"), el("th", { scope: "col" }, "Method"), ...shown.map((c) => el("th", { scope: "col", class: "number" }, titled(c))))),
    el("tbody", {}, ...paper.rows.map(([name, values]) => row("paper", name, values)), ...subjects.filter((s) => s.summary).map((s) => row(several ? runs[s.run].name : "here", s.title, own(s)))),
  );
  $("paper-about").textContent = `ReactSim-Bench, arXiv 2606.14058, table 1: ${paper.scenarios} scenarios of nuPlan. Comparable with runs on these scenarios with their official AVs.`;
}

/** Table of events per scenario, and the share of scenarios with at least one. */
function eventTable() {
  const shown = EVENT_METRICS.filter((id) => metric(id));
  $("events-table").replaceChildren(
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Method"), ...shown.map((id) => el("th", { scope: "col", class: "number" }, metric(id).title)))),
    el("tbody", {}, ...subjects.map((s) => el("tr", {}, el("th", { scope: "row" }, s.name), ...shown.map((id) => {
      let [events, having, all] = [0, 0, 0];
      const rollouts = s.settings.rollouts || 1;
      if (metric(id).av && !s.planner) return el("td", { class: "number" }, "–");
      for (let i = 0; i < scenarios.id.length; i++) {
        if (!has(s.index, i) || !part.has(s.run, i)) continue;
        const n = counted(s.index, id, i);
        all++;
        events += n / rollouts;
        having += n > 0;
      }
      return el("td", { class: "number", title: `${having} of ${count(all, "scenario")} have at least one` }, all ? (events / all).toFixed(2) : "–", el("small", {}, all ? ` in ${((100 * having) / all).toFixed(0)} %` : ""));
    })))),
  );
}

/** Returns whether a subject has a result in a scenario. */
const has = (subject, scenario) => scenarios.values[subject].some((column) => column[scenario] !== null && column[scenario] !== undefined);

/** The chosen part and order of the table, for the address. */
export const chosen = () => ({ part: part === PARTS[0] ? "" : part.name, sort: sorted.by === null ? "" : `${sorted.down ? "-" : ""}${sorted.by}` });

/** Shows all tables, as in an address. `call` is called after every change. */
export function results(asked, call) {
  part = PARTS.find((p) => p.name === asked.get("part")) ?? PARTS[0];
  const by = asked.get("sort");
  if (by) sorted = { by: by.replace(/^-/, ""), down: by.startsWith("-") };
  const choose = (chosen) => () => {
    part = chosen;
    show();
  };
  $("parts").replaceChildren(...PARTS.map((p) => el("button", { "data-part": p.name, onclick: choose(p) }, p.label)));
  $("all-metrics").onchange = () => {
    isWhole = $("all-metrics").checked;
    show();
  };
  show();
  onChange = call;
}

/** Shows the provenance of the numbers. */
export function provenance() {
  const row = (name, ...texts) => el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, ...texts));
  $("provenance-body").replaceChildren(...runs.map((run) => {
    const p = run.summary.provenance;
    const settings = Object.entries(p.settings).map(([k, v]) => `${k} ${v}`).join(", ");
    return el("details", { open: runs.length <= 3 }, el("summary", {}, run.name), el("table", { class: "facts" },
      el("tbody", {},
        row("program", `reactsim ${p.version}, commit ${p.commit}`),
        row("settings", settings),
        row("scenarios", `${p.scenarios}, BLAKE3 of ids and digests ${p.scenarios_blake3}`),
        ...p.inputs.map((f) => row("input", `${f.name} (${f.format}, ${f.bytes.toLocaleString("en")} bytes, BLAKE3 ${f.blake3})`)),
        p.deviations ? row("deviations", `${p.deviations.name} (BLAKE3 ${p.deviations.blake3})`) : null,
        ...p.simulators.map((s) => row(s.id, [
          s.title,
          s.weights ? `weights ${s.weights.name} (SHA-256 ${s.weights.sha256})` : null,
          ...Object.entries(s.parameters ?? {}).map(([k, v]) => `${k} = ${v}`),
          ...Object.entries(run.summary.simulators[s.id]?.outcomes ?? {}).map(([k, n]) => `${n} ${k}`),
        ].filter(Boolean).join("; "))),
        run.notes.length ? row("notes", el("ul", {}, ...run.notes.map((text) => el("li", {}, text)))) : null,
        row("failures", p.failures.length ? el("ul", {}, ...p.failures.map((f) => el("li", {}, `${f.file} record ${f.record}${f.simulator ? ` (${f.simulator})` : ""}: ${f.error}`))) : "none"))));
  }));
}
