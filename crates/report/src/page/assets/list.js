// The list of scenarios. Only visible rows are elements, so that thousands of rows cost no more than a
// dozen.

import { avMetrics, categories, counted, difficulties, hasValues, metric, ownMetrics, runs, scenarios, subjects, value, verdict } from "./data.js";
import { $, el } from "./dom.js";
import { count, number, titled } from "./format.js";
import { drawable } from "./scenes.js";

/** Height of a row, pixels. */
const ROW = 26;
/** Metrics that are meaningful for a single scenario. */
const SHOWN = [...avMetrics, "aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "acceleration", "curvature", "ade", "progress", "over-reaction", "over-braking", "undisturbed-loss", "red-light", "log-clinging", ...ownMetrics];
/** Maximum number of subjects with a column. */
const MOST = 12;

const fair = subjects.filter((s) => !s.oracle).map((s) => s.index);
const collides = (s, i) => counted(s, "aav-collision", i) > 0;
/** Whether the AV is at fault for a collision; null if it is not judged. */
const atFault = (s, i) => {
  const v = value(s.index, "av-at-fault-collisions", i);
  return v === null ? null : v < 1;
};
const judged = subjects.filter((s) => s.planner);
const ran = (s, i) => value(s, "aav-collision", i) !== null;

/** Filters in addition to category, difficulty and id. */
const CONDITIONS = [
  ["", "all", () => true],
  ["scene", "with a scene", drawable],
  ...(judged.length ? [
    ["verdict", "traffic decides whether the AV is at fault", (i) => runs.some((_, run) => new Set(judged.filter((s) => s.run === run).map((s) => atFault(s, i)).filter((v) => v !== null)).size > 1)],
    ["fault", "the AV is at fault for a collision", (i) => judged.some((s) => atFault(s, i))],
  ] : []),
  ["differ", "simulators differ", (i) => fair.some((s) => ran(s, i) && collides(s, i)) && fair.some((s) => ran(s, i) && !collides(s, i))],
  ["collision", "some simulator hits the AV", (i) => fair.some((s) => collides(s, i))],
  ["risky", "some simulator is risky", (i) => fair.some((s) => counted(s, "aav-ttc", i) > 0)],
  ["agents", "agents hit each other", (i) => fair.some((s) => counted(s, "aa-collision", i) > 0)],
  ["offroad", "an agent leaves the road", (i) => fair.some((s) => counted(s, "offroad", i) > 0)],
  ["against", "an agent drives against the lane", (i) => fair.some((s) => counted(s, "direction", i) > 0)],
  ["red", "a vehicle runs a red light", (i) => fair.some((s) => counted(s, "red-light", i) > 0)],
];

const state = { text: "", category: "", difficulty: "", condition: "", metric: verdict ?? SHOWN.find((id) => metric(id)) ?? null, by: null, down: true };
const USUAL = { ...state };
let order = [];
let cursor = 0;
let open = null;
/** Subjects with values of the chosen metric; the log as planner last. */
let columns = [];

function choose() {
  const having = subjects.filter((s) => hasValues(s.index, state.metric)).sort((a, b) => (a.planner === "log") - (b.planner === "log"));
  columns = (having.length ? having : subjects).slice(0, MOST);
}

function sift() {
  const condition = CONDITIONS.find(([key]) => key === state.condition)[2];
  const text = state.text.toLowerCase();
  order = [];
  for (let i = 0; i < scenarios.id.length; i++) {
    if (text && !scenarios.id[i].toLowerCase().includes(text)) continue;
    if (state.category && scenarios.category[i] !== state.category) continue;
    if (state.difficulty && scenarios.difficulty[i] !== state.difficulty) continue;
    if (condition(i)) order.push(i);
  }
  if (state.by === "id") order.sort((a, b) => (scenarios.id[a] < scenarios.id[b] ? -1 : 1) * (state.down ? -1 : 1));
  else if (state.by === "category") order.sort((a, b) => ((scenarios.category[a] ?? "") < (scenarios.category[b] ?? "") ? -1 : 1) * (state.down ? -1 : 1));
  else if (state.by !== null) {
    // Scenarios without a value come last in either order.
    const key = (i) => value(state.by, state.metric, i);
    order.sort((a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === null || y === null) return (x === null) - (y === null) || a - b;
      return (state.down ? y - x : x - y) || a - b;
    });
  }
  cursor = Math.min(cursor, Math.max(0, order.length - 1));
  $("list-count").textContent = `${count(order.length, "scenario")} of ${scenarios.id.length.toLocaleString("en")}`;
  $("list").setAttribute("aria-rowcount", order.length + 1);
}

function row(at) {
  const i = order[at];
  const m = metric(state.metric);
  const cells = columns.map((s) => {
    const v = value(s.index, state.metric, i);
    const isBad = m.av ? v === 0 : m.lower_is_better && v > 0 && !m.own && !["m", "m/s²"].includes(m.unit);
    return el("span", { role: "gridcell", class: `number${isBad ? " bad" : ""}` }, v === null ? "–" : number(m, v));
  });
  return el("div", { role: "row", id: `row-${i}`, class: `row${at === cursor ? " cursor" : ""}${i === open ? " open" : ""}`, "aria-rowindex": at + 2, "aria-selected": String(i === open), style: `top:${at * ROW}px`, "data-scenario": i, onclick: () => go(at) },
    el("span", { role: "gridcell", class: "mark", title: drawable(i) ? "has a scene" : "no scene in this page" }, drawable(i) ? "◆" : ""),
    el("span", { role: "gridcell", class: "id", title: scenarios.id[i] }, scenarios.id[i]),
    el("span", { role: "gridcell" }, scenarios.category[i] ?? ""),
    ...cells);
}

function draw() {
  const list = $("list");
  const from = Math.max(0, Math.floor(list.scrollTop / ROW) - 4);
  const to = Math.min(order.length, Math.ceil((list.scrollTop + list.clientHeight) / ROW) + 4);
  $("list-body").style.height = `${order.length * ROW}px`;
  const rows = [];
  for (let at = from; at < to; at++) rows.push(row(at));
  // The row of the keyboard cursor exists even out of view: screen readers use it as the active element.
  if (order.length && (cursor < from || cursor >= to)) rows.push(row(cursor));
  $("list-body").replaceChildren(...rows);
  if (order.length) list.setAttribute("aria-activedescendant", `row-${order[cursor]}`);
  else list.removeAttribute("aria-activedescendant");
}

function heads() {
  const head = (label, key, about, numeric) => {
    const isBy = state.by === key;
    return el("span", { role: "columnheader", class: numeric ? "number" : null, "aria-sort": isBy ? (state.down ? "descending" : "ascending") : "none" },
      el("button", { class: "sort", title: about, "data-key": key, onclick: () => {
        state.down = isBy ? !state.down : numeric === true;
        state.by = key;
        refresh();
        $("list-head").querySelector(`[data-key="${key}"]`)?.focus();
      } }, label, el("span", { "aria-hidden": "true" }, isBy ? (state.down ? " ▾" : " ▴") : "")));
  };
  $("list-head").replaceChildren(
    el("span", { role: "columnheader", title: "has a scene" }, "◆"),
    head("scenario", "id", "Sort by id"),
    head("category", "category", "Sort by category"),
    ...columns.map((s) => head(s.name, s.index, `${s.name}: ${titled(metric(state.metric))}`, true)));
  const grid = `18px minmax(110px, 1.6fr) 96px repeat(${columns.length}, minmax(64px, 1fr))`;
  $("list-scroll").style.setProperty("--grid", grid);
  $("list-scroll").style.setProperty("--least", `${270 + 74 * columns.length}px`);
}

function refresh() {
  choose();
  heads();
  sift();
  draw();
  onFilter();
}

function move(to) {
  if (!order.length) return;
  cursor = Math.min(order.length - 1, Math.max(0, to));
  const list = $("list");
  if (cursor * ROW < list.scrollTop) list.scrollTop = cursor * ROW;
  // The head covers the upper end.
  const seen = list.clientHeight - $("list-head").offsetHeight;
  if ((cursor + 1) * ROW > list.scrollTop + seen) list.scrollTop = (cursor + 1) * ROW - seen;
  draw();
}

let onOpen = () => {};

function go(at) {
  move(at);
  if (order[at] !== undefined) onOpen(order[at]);
}

/** Marks the scenario that the viewer shows. */
export function mark(index) {
  open = index;
  const at = order.indexOf(index);
  if (at >= 0) move(at);
  else draw();
}

/** The next listed scenario with a scene, before or after the one shown; null if there is none. */
export function neighbour(direction) {
  for (let at = order.indexOf(open) + direction; at >= 0 && at < order.length; at += direction) if (drawable(order[at])) return order[at];
  return null;
}

/** The parts of the state that an address has, with their names there. */
const ADDRESS = { text: "id", category: "category", difficulty: "difficulty", condition: "show", metric: "values" };

/** Filters and order, for the address; empty where they are the usual ones. */
export function filters() {
  const all = Object.entries(ADDRESS).map(([key, name]) => [name, state[key] === USUAL[key] ? "" : state[key]]);
  const by = typeof state.by === "number" ? subjects[state.by].name : state.by;
  return Object.fromEntries([...all, ["order", by === null ? "" : `${state.down ? "-" : ""}${by}`]]);
}

/** Takes filters and order from an address. */
function restore(asked) {
  const known = { category: categories, difficulty: difficulties, condition: CONDITIONS.map(([k]) => k), metric: SHOWN.filter((id) => metric(id)) };
  for (const [key, name] of Object.entries(ADDRESS)) {
    const found = asked.get(name);
    if (found && (key === "text" || known[key].includes(found))) state[key] = found;
  }
  const order = asked.get("order");
  if (!order) return;
  const by = order.replace(/^-/, "");
  const subject = subjects.findIndex((s) => s.name === by);
  if (["id", "category"].includes(by) || subject >= 0) [state.by, state.down] = [subject >= 0 ? subject : by, order.startsWith("-")];
}

let onFilter = () => {};

/** Creates the list as in an address; `call` is called with the scenario to show, `changed` after every change. */
export function list(asked, call, changed) {
  onOpen = call;
  restore(asked);
  $("list-text").value = state.text;
  const field = (id, key, items) => {
    $(id).replaceChildren(...items.map(([v, label]) => el("option", { value: v }, label)));
    $(id).value = state[key];
    $(id).addEventListener("change", () => {
      state[key] = $(id).value;
      $("list").scrollTop = 0;
      cursor = 0;
      refresh();
    });
  };
  field("list-category", "category", [["", "all"], ...categories.map((c) => [c, c])]);
  field("list-difficulty", "difficulty", [["", "all"], ...difficulties.map((d) => [d, d])]);
  $("list-difficulty").parentElement.hidden = !difficulties.length;
  field("list-condition", "condition", CONDITIONS.map(([k, label]) => [k, label]));
  field("list-metric", "metric", SHOWN.filter((id) => metric(id)).map((id) => [id, titled(metric(id))]));
  $("list-text").addEventListener("input", () => {
    state.text = $("list-text").value.trim();
    cursor = 0;
    $("list").scrollTop = 0;
    refresh();
  });
  $("list").addEventListener("scroll", draw, { passive: true });
  new ResizeObserver(draw).observe($("list"));
  $("list").addEventListener("keydown", (event) => {
    const page = Math.max(1, Math.floor($("list").clientHeight / ROW) - 1);
    const by = { ArrowDown: cursor + 1, ArrowUp: cursor - 1, PageDown: cursor + page, PageUp: cursor - page, Home: 0, End: order.length - 1 }[event.key];
    if (by === undefined && event.key !== "Enter") return;
    event.preventDefault();
    event.stopPropagation();
    if (by === undefined) go(cursor);
    else move(by);
  });
  refresh();
  onFilter = changed;
}
