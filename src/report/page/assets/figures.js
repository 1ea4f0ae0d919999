// Figures of the paper for the runs of the page.

import { chart, mark, series, steps, ticks } from "./charts.js";
import { categories, runs, scenarios, subjects } from "./data.js";
import { $, el, svg } from "./dom.js";
import { count } from "./format.js";

const CATEGORY = { longitudinal: [0, "var(--longitudinal)"], lateral: [1, "var(--lateral)"], directional: [2, "var(--directional)"] };
const tint = (i) => `var(--subject-${i % 8})`;
const mean = (subject, id) => subject.summary?.metrics[id];

/** Deviations of the AVs from the log, by category, of the first run that has them. */
function deviations() {
  const columns = scenarios.deviation.find((d) => d.endpoint_lateral);
  if (!columns || !categories.length) return [];
  const of = (name) => categories.map((c) => [c, scenarios.category.flatMap((k, i) => (k === c && columns[name]?.[i] != null ? [[i, columns[name][i]]] : []))]);
  const legend = categories.map((c) => [`${c} (${scenarios.category.filter((k) => k === c).length})`, ...CATEGORY[c] ?? [3, "var(--dim)"]]);
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
      name: "endpoints", title: "End points of deviated AVs", about: `Offset of the AV's last position from the logged one, in the logged AV's axes; ${count(points.length, "scenario")}.`,
      x: { label: "ahead of the log (m)", ...spread(points.map((p) => p[2]), 5) }, y: { label: "left of the log (m)", ...spread(points.map((p) => p[3]), 5) }, legend,
      draw: (h, v) => points.map(([c, i, x, y]) => mark(CATEGORY[c]?.[0] ?? 3, h(x), v(y), CATEGORY[c]?.[1] ?? "var(--dim)", { r: 2.8, opacity: 0.7, title: scenarios.id[i], "data-x": x, "data-y": y })),
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
      name, title, about: `Share of the scenarios of each category; ${count(all.length, "scenario")}.`,
      x: { label, min, max }, y: { label: "share", min: 0, max: top * 1.05 }, legend: legend.map(([text, , ink]) => [text, null, ink]),
      draw: (h, v) => bins.map(([c, list, n]) => {
        const path = steps(list, width, CATEGORY[c]?.[1] ?? "var(--dim)", h, v);
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
    const max = Math.max(0.1, ...rows.map((s) => mean(s, id)?.high ?? 0));
    return chart({
      name: `count-${id}`, title, about: "Means with 95 % intervals; less is better.", x: { label, min: -0.62 * max, max: max * 1.06, marks: ticks(0, max, 4) },
      y: { label: "", min: -0.5, max: rows.length - 0.5, marks: [] },
      draw: (h, v) => rows.flatMap((s, i) => {
        const e = mean(s, id), y = v(rows.length - 1 - i);
        if (e?.mean == null) return [];
        return [
          svg("text", { x: h(0) - 8, y: y + 4, "font-size": 11, "text-anchor": "end", fill: "var(--text)" }, named(s), svg("title", {}, s.name)),
          svg("line", { x1: h(e.low), x2: h(e.high), y1: y, y2: y, stroke: tint(i), "stroke-width": 2 }),
          mark(i % 4, h(e.mean), y, tint(i), { r: 4.2, title: `${s.name}: ${e.mean.toFixed(3)}`, "data-subject": s.index, "data-x": e.mean }),
        ];
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
    const top = Math.max(0.1, ...lines.flat().map(([, e]) => e.high));
    return [chart({
      name: `replan-${id}`, title, about: "Means with 95 % intervals. Replanning is more frequent towards the left.",
      x: { label: "replan interval", min: marks[0] * 0.85, max: marks.at(-1) * 1.15, log: true, marks, text }, y: { label, min: 0, max: top * 1.05 },
      legend: lines.map((line, i) => [line[0][2].title, i, tint(i)]),
      draw: (h, v) => lines.flatMap((line, i) => series(line.map(([steps, e, s]) => [steps, e.mean, e.low, e.high, `${s.title}, ${text(steps)}: ${e.mean.toFixed(3)}`]), i, tint(i), h, v)),
    })];
  });
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
  const points = pairs.map(([a, b]) => [a, mean(b, "kinematic-likelihood"), mean(a, "aav-collision")]).filter(([, x, y]) => x?.mean != null && y?.mean != null);
  if (!points.length) return [];
  const [low, high] = [Math.min(...points.map(([, x]) => x.low)), Math.max(...points.map(([, x]) => x.high))];
  return [chart({
    name: "realism-reactive", title: "Realism and reaction", about: "Kinematic likelihood in the realism protocol (more is better) against collisions with the AV in the reactive one (less is better).",
    x: { label: "kinematic likelihood (realism protocol)", min: low - 0.02, max: high + 0.02 }, y: { label: "A-AV collisions (reactive protocol)", min: 0, max: 1.06 * Math.max(0.1, ...points.map(([, , y]) => y.high)) },
    legend: points.map(([s], i) => [s.title, i, tint(i)]),
    draw: (h, v) => points.flatMap(([s, x, y], i) => [
      svg("line", { x1: h(x.low), x2: h(x.high), y1: v(y.mean), y2: v(y.mean), stroke: tint(i), opacity: 0.45 }),
      ...series([[x.mean, y.mean, y.low, y.high, `${s.title}: ${x.mean.toFixed(3)}, ${y.mean.toFixed(3)}`]], i, tint(i), h, v),
    ]),
  })];
}

/** Draws all figures for which the runs have data. */
export function figures() {
  const all = [...replanning(), ...realism(), ...counts(), ...deviations()];
  $("figures-body").replaceChildren(...(all.length ? all : [el("p", { class: "dim" }, "These runs have no data for figures.")]));
}
