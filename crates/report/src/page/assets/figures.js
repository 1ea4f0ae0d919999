// Figures of the paper for the runs of the page.

import { chart, mark, series, steps, ticks } from "./charts.js";
import { categories, data, metric, runs, scenarios, subjects, value } from "./data.js";
import { $, el, svg } from "./dom.js";
import { count, titled } from "./format.js";

const CATEGORY = { longitudinal: [0, "var(--longitudinal)"], lateral: [1, "var(--lateral)"], directional: [2, "var(--directional)"] };
const tint = (i) => `var(--subject-${i % 8})`;
/** Models in their order, each of which has one colour on the page. */
const models = [...new Set(subjects.map((s) => s.id))];
const ink = (s) => tint(models.indexOf(s.id));
const mean = (subject, id) => subject.summary?.metrics[id];

/** Runs with the same AVs, which share their figures. */
function avSets() {
  const sets = new Map();
  scenarios.deviation.forEach((columns, run) => {
    if (!columns.endpoint_lateral && !columns.ade) return;
    const key = JSON.stringify([columns, scenarios.categories[run]]);
    sets.set(key, [...sets.get(key) ?? [], run]);
  });
  return [...sets.values()];
}

/** Deviations of the AVs from the log, by category: figures for every set of AVs. */
const deviations = () => avSets().flatMap((members, i, all) => deviationsOf(members, i, all.length));

function deviationsOf(members, set, sets) {
  const [run] = members;
  const columns = scenarios.deviation[run];
  const own = scenarios.categories[run];
  const drawn = [...categories.filter((c) => own.includes(c)), ...(own.includes(null) ? [null] : [])];
  const of = (name) => drawn.map((c) => [c, own.flatMap((k, i) => (k === c && columns[name]?.[i] != null ? [[i, columns[name][i]]] : []))]);
  const look = (c) => CATEGORY[c] ?? [3, "var(--dim)"];
  const key = (groups) => groups.filter(([, list]) => list.length).map(([c, list]) => [`${c ?? "no category"} (${list.length})`, ...look(c)]);
  const whose = sets > 1 ? ` AVs of ${members.map((r) => runs[r].name).join(", ")}.` : "";
  const named = (name) => (set ? `${name}-${set + 1}` : name);
  const spread = (values, least) => {
    const [low, high] = [Math.min(0, ...values), Math.max(least, ...values)];
    const margin = 0.04 * (high - low);
    return { min: low < 0 ? low - margin : 0, max: high + margin };
  };
  const along = of("endpoint_longitudinal"), aside = new Map(of("endpoint_lateral").flatMap(([, list]) => list));
  const points = along.flatMap(([c, list]) => list.filter(([i]) => aside.has(i)).map(([i, x]) => [c, i, x, aside.get(i)]));
  const out = [];
  if (points.length) {
    out.push(chart({
      name: named("endpoints"), title: "End points of deviated AVs", about: `Offset of the AV's last position from the logged one, in the logged AV's axes; ${count(points.length, "scenario")}.${whose}`,
      x: { label: "ahead of the log (m)", ...spread(points.map((p) => p[2]), 5) }, y: { label: "left of the log (m)", ...spread(points.map((p) => p[3]), 5) }, legend: key(drawn.map((c) => [c, points.filter((p) => p[0] === c)])),
      draw: (h, v) => points.map(([c, i, x, y]) => mark(look(c)[0], h(x), v(y), look(c)[1], { r: 2.8, opacity: 0.7, title: scenarios.id[i], "data-x": x, "data-y": y })),
    }));
  }
  const histogram = (name, column, title, label) => {
    const groups = of(column).filter(([, list]) => list.length);
    const all = groups.flatMap(([, list]) => list.map((p) => p[1]));
    if (!all.length) return;
    const { min, max } = spread(all, 1);
    const n = 24, width = (max - min) / n;
    const bins = groups.map(([c, list]) => {
      const counts = new Array(n).fill(0);
      for (const [, v] of list) counts[Math.min(n - 1, Math.max(0, Math.floor((v - min) / width)))]++;
      return [c, counts.map((k, i) => [min + i * width, k / list.length]), list.length];
    });
    const top = Math.max(...bins.flatMap(([, list]) => list.map((b) => b[1])));
    out.push(chart({
      name: named(name), title, about: `Share of the scenarios of each category; ${count(all.length, "scenario")}.${whose}`,
      x: { label, min, max }, y: { label: "share", min: 0, max: top * 1.05 }, legend: key(groups).map(([text, , ink]) => [text, null, ink]),
      draw: (h, v) => bins.map(([c, list, n]) => {
        const path = steps(list, width, look(c)[1], h, v);
        path.setAttribute("data-category", c);
        path.setAttribute("data-n", n);
        return path;
      }),
    }));
  };
  histogram("deviation-ade", "ade", "Displacement of deviated AVs from the log", "mean displacement (m)");
  histogram("deviation-speed", "mean_speed_difference", "Speed of deviated AVs relative to the log", "mean speed difference (m/s)");
  return out;
}

/** Collisions with the AV and risky approaches of every simulator, with intervals. */
function counts() {
  const rows = subjects.filter((s) => mean(s, "aav-collision")?.mean != null);
  if (!rows.length || rows.length > 24) return [];
  const named = (s) => (s.name.length > 24 ? `${s.name.slice(0, 23)}…` : s.name);
  return [["aav-collision", "At fault for collisions with the AV", "vehicles per scenario"], ["aav-ttc", "Risky approaches to the AV", "vehicles per scenario"]].map(([id, title, label]) => {
    const max = Math.max(0.1, ...rows.map((s) => mean(s, id)?.high ?? mean(s, id)?.mean ?? 0));
    return chart({
      name: `count-${id}`, title, about: "Means with 95 % intervals; less is better.", x: { label, min: -0.62 * max, max: max * 1.06, marks: ticks(0, max, 4) },
      y: { label: "", min: -0.5, max: rows.length - 0.5, marks: [] }, height: Math.max(340, 88 + 18 * rows.length),
      draw: (h, v) => rows.flatMap((s, i) => {
        const e = mean(s, id), y = v(rows.length - 1 - i);
        if (e?.mean == null) return [];
        return [
          svg("text", { x: h(0) - 8, y: y + 4, "font-size": 11, "text-anchor": "end", fill: "var(--text)" }, named(s), svg("title", {}, s.name)),
          e.low === null ? null : svg("line", { x1: h(e.low), x2: h(e.high), y1: y, y2: y, stroke: ink(s), "stroke-width": 2 }),
          mark(s.run % 4, h(e.mean), y, ink(s), { r: 4.2, title: `${s.name}: ${e.mean.toFixed(3)}`, "data-subject": s.index, "data-x": e.mean }),
        ].filter(Boolean);
      }),
    });
  });
}

/** Groups of runs that differ only in one setting. */
function families(setting) {
  const groups = new Map();
  for (const s of subjects) {
    const { [setting]: own, ...same } = s.settings;
    const key = JSON.stringify([same, s.id, runs[s.run].summary.provenance.scenarios_blake3, runs[s.run].summary.provenance.simulators.find((r) => r.id === s.id)?.parameters ?? {}]);
    if (!groups.has(key)) groups.set(key, []);
    // The same run may be part of two studies.
    if (!groups.get(key).some(([other]) => other === own)) groups.get(key).push([own, s]);
  }
  return [...groups.values()].filter((g) => new Set(g.map(([own]) => own)).size > 1);
}

/**
 * The paper's figures of the replan interval: reaction in the reactive protocol, similarity to the log in
 * the realism protocol.
 */
const REPLANNING = [
  ["reactive", "aav-collision", "Collisions with the AV by replan interval", "vehicles per scenario"],
  ["reactive", "aav-ttc", "Risky approaches by replan interval", "vehicles per scenario"],
  ["realism", "ade", "Distance to the log by replan interval", "ADE, m"],
  ["realism", "kinematic-likelihood", "Likelihood of the log by replan interval", "kinematic likelihood"],
];

function replanning() {
  const all = families("replan_steps");
  const text = (t) => `${t / 10} s`;
  return REPLANNING.flatMap(([protocol, id, title, label]) => {
    const groups = all.filter(([[, s]]) => s.settings.protocol === protocol);
    if (!groups.length) return [];
    const marks = [...new Set(groups.flatMap((g) => g.map(([steps]) => steps)))].sort((a, b) => a - b);
    const lines = groups.map((group) => group.map(([steps, s]) => [steps, mean(s, id), s]).filter(([, e]) => e?.mean != null).sort((a, b) => a[0] - b[0])).filter((line) => line.length);
    if (!lines.length) return [];
    const top = Math.max(0.1, ...lines.flat().map(([, e]) => e.high ?? e.mean));
    return [chart({
      name: `replan-${id}`, title, about: "Means with 95 % intervals. Replanning is more frequent towards the left.",
      x: { label: "replan interval", min: marks[0] * 0.85, max: marks.at(-1) * 1.15, log: true, marks, text }, y: { label, min: 0, max: top * 1.05 },
      legend: lines.map((line, i) => [line[0][2].title, i, ink(line[0][2])]),
      draw: (h, v) => lines.flatMap((line, i) => series(line.map(([steps, e, s]) => [steps, e.mean, e.low, e.high, `${s.title}, ${text(steps)}: ${e.mean.toFixed(3)}`]), i, ink(line[0][2]), h, v)),
    })];
  });
}

/**
 * A measure of realism against collisions with the AV in the reactive protocol. `points`: subject, estimates
 * of both.
 */
function againstReaction(name, measure, about, label, points) {
  const known = points.filter(([, x, y]) => x?.mean != null && y?.mean != null);
  if (!known.length) return [];
  const [low, high] = [Math.min(...known.map(([, x]) => x.low ?? x.mean)), Math.max(...known.map(([, x]) => x.high ?? x.mean))];
  return [chart({
    name, title: `Realism and reaction: ${measure}`, about: `${about} (more is better) against collisions with the AV in the reactive protocol (less is better).`,
    x: { label, min: low - 0.02, max: high + 0.02 }, y: { label: "A-AV collisions (reactive protocol)", min: 0, max: 1.06 * Math.max(0.1, ...known.map(([, , y]) => y.high ?? y.mean)) },
    legend: known.map(([s], i) => [s.title, i, ink(s)]),
    draw: (h, v) => known.flatMap(([s, x, y], i) => [
      x.low === null ? null : svg("line", { x1: h(x.low), x2: h(x.high), y1: v(y.mean), y2: v(y.mean), stroke: ink(s), opacity: 0.45 }),
      ...series([[x.mean, y.mean, y.low, y.high, `${s.title}: ${x.mean.toFixed(3)}, ${y.mean.toFixed(3)}`]], i, ink(s), h, v),
    ].filter(Boolean)),
  })];
}

/** Realism against reactive behaviour: simulators that ran in both protocols on the same scenarios. */
function realism() {
  const of = (protocol) => subjects.filter((s) => s.settings.protocol === protocol);
  const same = (a, b) => b.id === a.id && a.settings.replan_steps === b.settings.replan_steps && runs[a.run].summary.provenance.scenarios_blake3 === runs[b.run].summary.provenance.scenarios_blake3;
  const study = (s) => runs[s.run].study?.[0];
  // Among several reactive runs, prefer the one of the same study, else take the first.
  const pairs = of("realism").flatMap((b) => {
    const found = of("reactive").filter((a) => same(a, b));
    const one = found.find((a) => study(a) === study(b)) ?? found[0];
    return one ? [[one, b]] : [];
  });
  const challenge = (s) => data.studies.find(({ name }) => name === study(s))?.numbers.realism?.find(({ id }) => id === s.id)?.aggregates.realism_meta_metric;
  return [
    ...againstReaction("realism-reactive", "kinematic likelihood", "Kinematic likelihood in the realism protocol", "kinematic likelihood (realism protocol)",
      pairs.map(([a, b]) => [a, mean(b, "kinematic-likelihood"), mean(a, "aav-collision")])),
    ...againstReaction("challenge-reactive", "Sim Agents metametric", "Realism metametric of the Sim Agents challenge 2025", "metametric (realism protocol)",
      pairs.map(([a, b]) => [a, challenge(b), mean(a, "aav-collision")])),
  ];
}

/** Shares of scenarios up to every value of a metric, one line per simulator. */
function distributions() {
  const shown = data.columns.filter((id) => metric(id));
  return shown.flatMap((id) => {
    const of = metric(id);
    const scale = of.unit === "rate" ? 100 : 1;
    const lines = subjects.map((s) => [s, scenarios.id.map((_, i) => value(s.index, id, i)).filter((v) => v !== null).map((v) => scale * v).sort((a, b) => a - b)]);
    const used = lines.filter(([, values]) => values.length > 1);
    const all = used.flatMap(([, values]) => values);
    const [low, high] = [all.reduce((a, b) => Math.min(a, b), 0), all.reduce((a, b) => Math.max(a, b), 0)];
    if (!used.length || low === high) return [];
    return [chart({
      name: `distribution-${id}`, title: `${of.title} by scenario`, about: `Share of the scenarios with at most this value; ${of.lower_is_better ? "higher" : "lower"} lines are better.`,
      x: { label: titled(of), min: low, max: high }, y: { label: "share of scenarios", min: 0, max: 1 },
      legend: used.map(([s]) => [s.name, null, ink(s)]),
      draw: (h, v) => used.map(([s, values]) => {
        let d = `M${h(low)} ${v(0)}`;
        values.forEach((x, i) => (d += `H${h(x).toFixed(1)}V${v((i + 1) / values.length).toFixed(1)}`));
        return svg("path", { d: `${d}H${h(high)}`, fill: "none", stroke: ink(s), "stroke-width": 1.6, "data-subject": s.index, "data-values": values.length });
      }),
    })];
  });
}

/** Draws all figures for which the runs have data. */
export function figures() {
  const all = [...replanning(), ...realism(), ...counts(), ...deviations()];
  const spread = distributions();
  if (spread.length) all.push(el("details", { class: "full", id: "distributions" }, el("summary", {}, "Distributions over scenarios, by metric"), el("div", { class: "cards" }, ...spread)));
  $("figures-body").replaceChildren(...(all.length ? all : [el("p", { class: "dim" }, "These runs have no data for figures.")]));
}
