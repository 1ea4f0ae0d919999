// The page: its state and its actions.

import * as api from "./api.js";
import { Camera } from "./camera.js";
import { Scrub, charts } from "./charts.js";
import { FRAMES, NOW } from "./decode.js";
import { View } from "./draw.js";
import { analyse, between } from "./geometry.js";
import { fill, listen, table } from "./keys.js";
import { alarm, ask, calm, toast } from "./notice.js";
import { colour, onChange } from "./palette.js";
import * as panel from "./panel.js";
import { Queue } from "./queue.js";
import { decode } from "./scenario.js";

const $ = (id) => document.getElementById(id);

/** Time for which the last frame is held before the replay restarts, frames. */
const HOLD_FRAMES = 8;
/** Largest number of cached scenarios, shown and prefetched. */
const MAX_CACHED = 8;

const show = { certificate: false, ghost: true, others: true, follow: false };
const camera = new Camera();
const view = new View($("view"), camera);
const scrub = new Scrub($("scrub"), seek);
const chart = charts({ speed: $("chart-speed"), ttc: $("chart-ttc"), gap: $("chart-gap") }, seek);

let queue, scenario, selected;
/** Frame shown, fractional. */
let time = NOW;
let isPlaying = false, speed = 1, isWriting = false, isDirty = true;
let reviewer = null, suggestion = "", agreed = null;
/** Index of the requested scenario; responses for others are outdated. */
let wanted = -1;
const cache = new Map();

// ---- scenarios

/** Returns a scenario from the cache or the server. */
function load(index) {
  if (!cache.has(index)) {
    const promise = api.scenario(index).then(decode);
    promise.catch(() => cache.delete(index));
    cache.set(index, promise);
    // Evict the oldest.
    if (cache.size > MAX_CACHED) cache.delete(cache.keys().next().value);
  }
  return cache.get(index);
}

async function open(index) {
  wanted = index;
  const begin = performance.now();
  let loaded;
  try {
    loaded = await load(index);
  } catch (error) {
    return alarm(`scenario ${index + 1} cannot be shown: ${error.message}`);
  }
  if (wanted !== index) return;
  scenario = loaded;
  history.replaceState(null, "", `#${index + 1}`);
  const verdict = queue.standings.get(index)?.verdict;
  const mentioned = verdict && scenario.candidates.find((c) => c.number === verdict.candidate);
  const filter = queue.state.startsWith("filter:") ? queue.state.slice(7) : null;
  select(
    (filter && scenario.candidates.find((c) => c.rejected_by === filter)) || mentioned ||
    scenario.candidates.find((c) => c.chosen) || scenario.candidates[0] || null,
    false,
  );
  time = NOW;
  fit();
  refresh();
  document.body.dataset.scenario = index;
  document.body.dataset.took = (performance.now() - begin).toFixed(1);
  // Prefetch the neighbours while this one is shown.
  for (const direction of [1, -1]) {
    const next = queue.step(index, direction);
    if (next !== null) load(next).catch(() => {});
  }
}

/** Fits the view to the AV's trajectories and to all agents that it touches. */
function fit() {
  const points = [...scenario.agents[0].track, ...(selected?.frames ?? [])];
  for (const [i, f] of selected?.analysis.first ?? []) {
    points.push(scenario.agents[i].track[Math.max(f - 20, NOW)]);
  }
  camera.fit(points.filter(Boolean));
  isDirty = true;
}

// ---- candidates

function select(candidate, redraw = true) {
  selected = candidate;
  if (selected && !selected.analysis) {
    selected.analysis = analyse(scenario.agents, selected.frames, (i) => scenario.agents[i].track);
    const responseTrack = (i) => selected.responses.get(i)?.frames ?? scenario.agents[i].track;
    selected.certified = selected.certificate
      ? analyse(scenario.agents, selected.frames, responseTrack)
      : null;
  }
  isDirty = true;
  if (redraw) refreshPanel();
}

/** Returns the interactions of the AV with the others as shown. */
const analysis = () => (show.certificate && selected?.certified) || selected?.analysis || null;

// ---- time

function seek(frame) {
  time = frame;
  setPlaying(false);
}

function setPlaying(value) {
  isPlaying = value;
  if (isPlaying && time >= FRAMES - 1) time = NOW;
  $("play").textContent = isPlaying ? "❚❚" : "▶";
  isDirty = true;
}

let before = 0;
function tick(now) {
  const passed = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (isPlaying) {
    time += passed * 10 * speed;
    if (time > FRAMES - 1 + HOLD_FRAMES) time = NOW;
    isDirty = true;
  }
  if (view.resize()) {
    if (scenario && !isDirty) fit();
    isDirty = true;
  }
  if (isDirty && scenario) {
    isDirty = false;
    draw();
  }
  requestAnimationFrame(tick);
}

function draw() {
  const t = Math.min(time, FRAMES - 1);
  if (show.follow) {
    const av = between(selected?.frames ?? scenario.agents[0].track, t);
    if (av) [camera.x, camera.y] = [av.x, av.y];
  }
  view.draw(scenario, selected, analysis(), t, show);
  scrub.draw(analysis(), t);
  $("time").textContent = `${((t - NOW) / 10).toFixed(1)} s`;
  const log = scenario.agents[0].track.map((s) => s?.v ?? NaN);
  const own = selected ? colour(selected.category) : colour("accent");
  const speeds = [{ name: "log", values: log, colour: colour("dim"), dashed: true }];
  if (selected) {
    speeds.unshift({ name: "candidate", values: selected.frames.map((s) => s?.v ?? NaN), colour: own });
  }
  chart.speed.draw(speeds, t);
  const both = (key) => {
    const number = (values) => values.map((v) => v ?? NaN);
    const curves = [];
    const hasResponses = show.certificate && !!selected?.certified;
    if (selected) {
      const values = number(selected.analysis[key]);
      curves.push({ name: "log replay", values, colour: own, dashed: hasResponses });
    }
    if (hasResponses) {
      curves.push({ name: "responses", values: number(selected.certified[key]), colour: colour("response") });
    }
    return curves;
  };
  chart.ttc.draw(both("ttc"), t);
  chart.gap.draw(both("gap"), t);
}

// ---- panel and bar

function refreshPanel() {
  const standing = queue.standings.get(scenario.index);
  panel.verdict($("verdict"), standing, scenario.stale && standing?.verdict);
  panel.candidates($("candidates"), scenario, selected, standing?.verdict, (candidate) => select(candidate));
  panel.details($("details"), selected);
  const modes = [];
  if (scenario.bare) modes.push(scenario.bare);
  if (show.certificate) {
    modes.push(selected?.certificate ? "certificate’s responses" : "no certificate: log replay");
  }
  if (!show.ghost) modes.push("log hidden");
  if (!show.others) modes.push("others hidden");
  if (show.follow) modes.push("following the AV");
  const label = (text) => Object.assign(document.createElement("span"), { textContent: text });
  $("modes").replaceChildren(...modes.map(label));
  isDirty = true;
}

function refresh() {
  const { shown, upTo } = queue.count(scenario.index);
  const tally = queue.tally();
  $("scenario").textContent = scenario.id;
  $("position").textContent = `${queue.shows(scenario.index) ? upTo : "–"} of ${shown}`;
  const done = tally.pick + tally.reject;
  $("bar").style.width = `${(100 * done) / tally.all}%`;
  $("progress-text").textContent = `${done} / ${tally.all} decided`;
  const counts = ["pick", "reject", "flag"].map((what) => {
    const span = document.createElement("span");
    span.className = what;
    span.textContent = `${{ pick: "✓", reject: "✗", flag: "⚑" }[what]} ${tally[what]}`;
    return span;
  });
  $("tally").replaceChildren(...counts, ...(tally.disagree ? [`≠ ${tally.disagree}`] : []));
  const agreement = agreed ? `; at the start of this page: ${agreed}` : "";
  $("tally").title = `picked, rejected, flagged${tally.disagree ? ", reviewers disagree" : ""}${agreement}`;
  refreshPanel();
}

// ---- decisions

async function name() {
  const given = await ask("Your name, as shown next to your decisions", reviewer ?? suggestion);
  if (!given) return;
  try {
    reviewer = await api.setReviewer(given);
    queue.reviewer = reviewer;
    $("reviewer").textContent = reviewer;
    document.body.dataset.reviewer = reviewer;
  } catch (error) {
    alarm(error.message);
  }
}

/** Sends one request at a time; null on failure. A decision counts once the server confirms it is on disk. */
async function write(send) {
  if (isWriting || !scenario) return null;
  if (!reviewer) await name();
  if (!reviewer) return null;
  isWriting = true;
  try {
    const standing = await send();
    calm();
    return { standing };
  } catch (error) {
    const isGone = error instanceof TypeError;
    const reason = isGone
      ? "the server is gone. Start `reactsim curate review` again; earlier decisions are kept."
      : error.message;
    alarm(`NOT written: ${reason}`);
    return null;
  } finally {
    isWriting = false;
  }
}

async function decide(decision, candidate, note) {
  const { index } = scenario ?? {};
  const decided = scenario?.candidates.find((c) => c.number === candidate);
  const done = await write(() => api.decide({ index, candidate, decision, note }));
  if (!done) return;
  queue.set(done.standing);
  if (scenario.index === index) scenario.stale = false;
  const against = decision === "pick" && decided?.rejected_by;
  const warning = against ? `, rejected by ${against}: only applied with --allow-rejected` : "";
  toast(`${panel.words({ decision, candidate })}${warning} · u: undo`);
  // After a rejected candidate or a dropped decision the scenario is still undecided.
  const stays = decision === "clear" || (decision === "reject" && candidate !== null);
  const next = stays ? null : queue.step(index, 1);
  if (next === null) refresh();
  else await open(next);
  document.body.dataset.written = Number(document.body.dataset.written ?? 0) + 1;
}

async function undo() {
  const done = await write(api.undo);
  if (!done) return;
  if (!done.standing) return toast("nothing to undo");
  queue.set(done.standing);
  toast("undone");
  if (done.standing.index === scenario.index) refresh();
  else await open(done.standing.index);
  document.body.dataset.written = Number(document.body.dataset.written ?? 0) + 1;
}

function step(direction) {
  const next = queue.step(wanted, direction);
  if (next === null) toast(direction > 0 ? "this is the last one" : "this is the first one");
  else open(next);
}

async function goTo() {
  const text = await ask("Scenario: number, id, or beginning of the id");
  if (!text) return;
  const ids = queue.entries.map((e) => e.id);
  let index = ids.indexOf(text);
  const number = /^\d+$/.test(text) ? Number(text) : 0;
  if (index < 0 && number >= 1 && number <= ids.length) index = number - 1;
  if (index < 0) index = ids.findIndex((id) => id.startsWith(text));
  if (index < 0) toast(`no scenario ${text}`);
  else open(index);
}

function toggle(key) {
  show[key] = !show[key];
  refreshPanel();
}

const act = {
  select(direction) {
    const list = scenario?.candidates ?? [];
    const at = list.indexOf(selected) + direction;
    if (list[at]) select(list[at]);
  },
  pick: () => selected && decide("pick", selected.number),
  rejectScenario: () => decide("reject", null),
  rejectCandidate: () => selected && decide("reject", selected.number),
  flag: () => decide("flag", selected?.number ?? null),
  async flagWithNote() {
    const note = await ask("Note: what should be checked?");
    if (note) decide("flag", selected?.number ?? null, note);
  },
  clear: () => decide("clear", null),
  undo,
  step,
  nextToDo() {
    const todo = queue.states.find(([key]) => key === "todo")[2];
    const isOpen = (i) => todo(queue.entries[i], queue.standings.get(i));
    const all = queue.entries.map((_, i) => (wanted + 1 + i) % queue.entries.length);
    const next = all.find(isOpen);
    if (next === undefined) toast("everything is decided");
    else open(next);
  },
  goTo,
  play: () => setPlaying(!isPlaying),
  frame: (by) => seek(Math.min(FRAMES - 1, Math.max(0, Math.round(time) + by))),
  rewind: () => seek(NOW),
  toConflict() {
    const at = analysis();
    const frame = at ? at.ttc.findIndex((_, f) => at.touching[f]?.size || at.risky[f]?.size) : -1;
    if (frame < 0) toast("no contact and no close call");
    else seek(frame);
  },
  speed() {
    speed = { 1: 2, 2: 0.5, 0.5: 1 }[speed];
    $("speed").textContent = `${speed}×`;
  },
  certificate: () => toggle("certificate"),
  ghost: () => toggle("ghost"),
  others: () => toggle("others"),
  follow: () => toggle("follow"),
  fit: () => scenario && (show.follow && toggle("follow"), fit()),
  zoom(factor) {
    camera.zoom(factor);
    isDirty = true;
  },
  help: () => $("help").showModal(),
};

// ---- pointer

$("view").addEventListener("wheel", (event) => {
  event.preventDefault();
  camera.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  isDirty = true;
}, { passive: false });
$("view").addEventListener("pointerdown", (event) => {
  $("view").setPointerCapture(event.pointerId);
  $("view").classList.add("dragging");
});
$("view").addEventListener("pointermove", (event) => {
  if (!(event.buttons & 1)) return;
  if (show.follow) toggle("follow");
  camera.pan(event.movementX, event.movementY);
  isDirty = true;
});
$("view").addEventListener("pointerup", () => $("view").classList.remove("dragging"));

// ---- beginning

function options(element, list, onSelect) {
  for (const [value, label] of list) element.append(new Option(label, value));
  element.addEventListener("change", () => {
    onSelect(element.value);
    element.blur();
    if (!queue.shows(wanted)) {
      const next = queue.step(-1, 1);
      if (next === null) toast("no such scenario");
      else return open(next);
    }
    refresh();
  });
}

async function begin() {
  const session = await api.session();
  ({ reviewer, suggestion } = session);
  agreed = session.agreement;
  queue = new Queue(session.overview, session.standings);
  queue.reviewer = reviewer;
  document.title = `${session.file} · review`;
  $("file").textContent = session.file;
  $("file").title = `decisions: ${session.journal}`;
  $("reviewer").textContent = reviewer ?? "set your name";
  document.body.dataset.reviewer = reviewer ?? "";
  options($("state"), queue.states, (value) => (queue.state = value));
  const categories = ["all", "longitudinal", "lateral", "directional"].map((name) => [name, name]);
  options($("category"), categories, (value) => (queue.category = value));
  const keys = table(act);
  listen(keys);
  fill($("help-keys"), keys);
  $("help").addEventListener("click", () => $("help").close());
  $("help-button").onclick = act.help;
  $("reviewer").onclick = name;
  $("alarm").onclick = calm;
  $("previous").onclick = () => step(-1);
  $("next").onclick = () => step(1);
  $("play").onclick = act.play;
  $("speed").onclick = act.speed;
  panel.legend($("legend"));
  onChange(() => {
    view.road.forget();
    panel.legend($("legend"));
    if (scenario) refreshPanel();
  });
  view.resize();
  if (session.warnings.length) alarm(session.warnings.join(" · "));
  // The scenario shown before a reload, else the first undecided one.
  const asked = Number(location.hash.slice(1)) - 1;
  const undecided = queue.entries.findIndex((_, i) => !queue.standings.get(i)?.verdict);
  await open(Number.isInteger(asked) && queue.entries[asked] ? asked : Math.max(undecided, 0));
  requestAnimationFrame(tick);
  if (!reviewer) name();
}

begin().catch((error) => alarm(`the review cannot begin: ${error.message}`));
