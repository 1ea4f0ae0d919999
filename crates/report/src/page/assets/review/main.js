// The page: its state and its actions.

import { Camera } from "./camera.js";
import { Chart } from "./curves.js";
import { USUAL } from "./decode.js";
import * as decisions from "./decisions.js";
import { $, el, toast } from "./dom.js";
import { View } from "./draw.js";
import { NO_RISK, RISKY, analyse, between } from "./geometry.js";
import { listen, table } from "./keys.js";
import { colour, onChange } from "./palette.js";
import * as panel from "./panel.js";
import * as queue from "./queue.js";
import { load } from "./scenario.js";
import { Scrub } from "./scrub.js";

const { data } = decisions;
/** Time for which the last frame is held before the replay restarts, frames. */
const HOLD_FRAMES = 8;

const show = { certificate: false, others: true, follow: false };
/** Both views have the same size and show the same place. */
const camera = new Camera();
const views = { log: new View($("log"), camera), candidate: new View($("view"), camera) };
const scrub = new Scrub($("scrub"), seek);
const chart = {
  speed: new Chart($("chart-speed"), { title: "AV speed", unit: "m/s", floor: 5 }, seek),
  ttc: new Chart($("chart-ttc"), { title: "Time to collision", unit: "s", top: NO_RISK, line: RISKY, cap: NO_RISK }, seek),
  gap: new Chart($("chart-gap"), { title: "Nearest agent", unit: "m", top: 15 }, seek),
};

let scenario, selected;
/** Frame shown, fractional. */
let time = USUAL.now;
let isPlaying = false, speed = 1, isDirty = true;
/** Index of the requested scenario; others that were loaded are outdated. */
let wanted = -1;

// ---- scenarios

async function open(index) {
  wanted = index;
  let loaded;
  try {
    loaded = await load(index);
  } catch (error) {
    return toast(`scenario ${data.from + index} cannot be shown: ${error.message}`);
  }
  if (wanted !== index) return;
  scenario = loaded;
  history.replaceState(null, "", `#${new URLSearchParams({ scenario: scenario.id })}`);
  const line = decisions.decision(scenario.id);
  const { candidates } = scenario;
  select(
    (line && candidates.find((c) => c.number === line.candidate)) || candidates.find((c) => c.chosen) ||
      candidates[0] || null,
    false,
  );
  time = scenario.now;
  fit();
  refresh();
  document.body.dataset.scenario = index;
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
    points.push(scenario.agents[i].track[Math.max(f - 20, scenario.now)]);
  }
  camera.fit(points.filter(Boolean));
  isDirty = true;
}

// ---- candidates

function select(candidate, redraw = true) {
  selected = candidate;
  if (selected && !selected.analysis) {
    selected.analysis = analyse(scenario.agents, selected.frames, (i) => scenario.agents[i].track, scenario.now);
    const responseTrack = (i) => selected.responses.get(i)?.frames ?? scenario.agents[i].track;
    selected.certified = selected.certificate
      ? analyse(scenario.agents, selected.frames, responseTrack, scenario.now)
      : null;
  }
  isDirty = true;
  if (redraw) refreshPanel();
}

/** Returns the interactions of the AV with the others as shown. */
const analysis = () => (show.certificate && selected?.certified) || selected?.analysis || null;

// ---- time

/** The last frame. */
const last = () => (scenario ?? USUAL).frames - 1;

function seek(frame) {
  time = frame;
  setPlaying(false);
}

function setPlaying(value) {
  isPlaying = value;
  if (isPlaying && time >= last()) time = (scenario ?? USUAL).now;
  $("play").textContent = isPlaying ? "❚❚" : "▶";
  isDirty = true;
}

let before = 0;
function tick(now) {
  const passed = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (isPlaying) {
    time += passed * 10 * speed;
    if (time > last() + HOLD_FRAMES) time = (scenario ?? USUAL).now;
    isDirty = true;
  }
  const sizes = Object.values(views).map((view) => view.resize());
  if (sizes.some((changed) => changed)) {
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
  const t = Math.min(time, last());
  if (show.follow) {
    const av = between(selected?.frames ?? scenario.agents[0].track, t);
    if (av) [camera.x, camera.y] = [av.x, av.y];
  }
  views.log.draw(scenario, null, scenario.logged, t, {});
  views.candidate.draw(scenario, selected, analysis(), t, show);
  scrub.draw(analysis(), t, scenario);
  $("time").textContent = `${((t - scenario.now) / 10).toFixed(1)} s`;
  const log = scenario.agents[0].track.map((s) => s?.v ?? NaN);
  const own = selected ? colour(selected.category) : colour("accent");
  const speeds = [{ name: "log", values: log, colour: colour("dim"), dashed: true }];
  if (selected) {
    speeds.unshift({ name: "candidate", values: selected.frames.map((s) => s?.v ?? NaN), colour: own });
  }
  chart.speed.draw(speeds, t, scenario);
  const both = (key) => {
    const values = (found) => found[key].map((v) => v ?? NaN);
    const curves = [{ name: "log", values: values(scenario.logged), colour: colour("dim"), dashed: true }];
    if (selected) curves.unshift({ name: "candidate", values: values(selected.analysis), colour: own });
    if (show.certificate && selected?.certified) {
      curves.push({ name: "responses", values: values(selected.certified), colour: colour("response") });
    }
    return curves;
  };
  chart.ttc.draw(both("ttc"), t, scenario);
  chart.gap.draw(both("gap"), t, scenario);
}

// ---- panel and bar

function refreshPanel() {
  const line = decisions.decision(scenario.id);
  panel.verdict($("verdict"), line);
  panel.candidates($("candidates"), scenario, selected, line, (candidate) => select(candidate));
  panel.details($("details"), selected);
  const modes = [];
  if (scenario.bare) modes.push(scenario.bare);
  if (show.certificate) {
    modes.push(selected?.certificate ? "certificate’s responses" : "no certificate: log replay");
  }
  if (!show.others) modes.push("others hidden");
  if (show.follow) modes.push("following the AV");
  $("modes").replaceChildren(...modes.map((text) => el("span", {}, text)));
  $("shown").textContent = selected ? `candidate #${selected.number}: ${selected.maneuver}` : "no candidate";
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
  const signs = { pick: "✓", reject: "✗", flag: "⚑" };
  $("tally").replaceChildren(...Object.entries(signs).map(([what, sign]) =>
    el("span", { class: what }, `${sign} ${tally[what]}`)));
  $("reviewer").textContent = decisions.reviewer() ?? "set your name";
  refreshPanel();
}

// ---- decisions

/** Asks for a line of text; null if the user cancels. */
function ask(label, value = "") {
  const dialog = $("ask");
  $("ask-label").textContent = label;
  $("ask-text").value = value;
  dialog.showModal();
  $("ask-text").select();
  return new Promise((resolve) => {
    const end = (text) => {
      dialog.onclose = null;
      dialog.close();
      resolve(text);
    };
    dialog.onclose = () => resolve(null);
    $("ask-cancel").onclick = () => end(null);
    dialog.querySelector("form").onsubmit = (event) => {
      event.preventDefault();
      end($("ask-text").value.trim());
    };
  });
}

async function name() {
  const given = await ask("Your name, as recorded with your decisions", decisions.reviewer() ?? "");
  if (!given) return;
  decisions.setReviewer(given);
  $("reviewer").textContent = given;
}

async function decide(decision, candidate, note) {
  if (!scenario) return;
  const { id, index, digest } = scenario;
  if (!decisions.reviewer()) await name();
  if (!decisions.reviewer()) return;
  const decided = scenario.candidates.find((c) => c.number === candidate);
  decisions.decide(id, {
    scenario_id: id,
    scenario_digest: digest,
    candidate,
    ...(decided && { candidate_digest: decided.digest }),
    decision,
    reviewer: decisions.reviewer(),
    at: new Date().toISOString(),
    ...(note && { note }),
  });
  const against = decision === "pick" && decided?.rejected_by;
  const warning = against ? `, rejected by ${against}: only applied with --allow-rejected` : "";
  toast(`${panel.words({ decision, candidate })}${warning} · u: undo`);
  // After a rejected candidate the scenario is still undecided.
  const stays = decision === "reject" && candidate !== null;
  const next = stays ? null : queue.step(index, 1);
  if (next === null) refresh();
  else await open(next);
}

async function undo() {
  const id = decisions.undo();
  if (id === undefined) return toast("nothing to undo");
  toast("undone");
  const index = data.scenarios.findIndex((entry) => entry.id === id);
  if (index < 0 || index === scenario.index) refresh();
  else await open(index);
}

function step(direction) {
  const next = queue.step(wanted, direction);
  if (next === null) toast(direction > 0 ? "this is the last one" : "this is the first one");
  else open(next);
}

/** Index of the scenario with this number in the file, this id, or an id that begins like this; negative if none. */
function find(text) {
  const ids = data.scenarios.map((entry) => entry.id);
  const exact = ids.indexOf(text);
  if (exact >= 0) return exact;
  const number = /^\d+$/.test(text) ? Number(text) - data.from : -1;
  return number >= 0 && number < ids.length ? number : ids.findIndex((id) => id.startsWith(text));
}

async function goTo() {
  const text = await ask("Scenario: number in the file, id, or beginning of the id");
  if (!text) return;
  const index = find(text);
  if (index < 0) toast(`no scenario ${text} in this page`);
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
  async flag() {
    const note = await ask("Note: what should be checked?");
    if (note !== null) decide("flag", selected?.number ?? null, note);
  },
  clear() {
    if (!scenario) return;
    decisions.decide(scenario.id, null);
    toast("decision dropped · u: undo");
    refresh();
  },
  undo,
  exportAll() {
    const n = decisions.exportAll();
    toast(`exported ${n} decision${n === 1 ? "" : "s"}`);
  },
  step,
  nextToDo() {
    const todo = queue.STATES.find(([key]) => key === "todo")[2];
    const all = data.scenarios.map((_, i) => (wanted + 1 + i) % data.scenarios.length);
    const next = all.find((i) => todo(data.scenarios[i]));
    if (next === undefined) toast("everything is decided");
    else open(next);
  },
  goTo,
  play: () => setPlaying(!isPlaying),
  frame: (by) => seek(Math.min(last(), Math.max(0, Math.round(time) + by))),
  rewind: () => seek((scenario ?? USUAL).now),
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

for (const { canvas } of Object.values(views)) {
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
    isDirty = true;
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1)) return;
    if (show.follow) toggle("follow");
    camera.pan(event.movementX, event.movementY);
    isDirty = true;
  });
}

// ---- beginning

function options(element, list, key) {
  element.append(...list.map(([value, label]) => new Option(label, value)));
  element.addEventListener("change", () => {
    queue.asked[key] = element.value;
    element.blur();
    if (!queue.shows(wanted)) {
      const next = queue.step(-1, 1);
      if (next === null) toast("no such scenario");
      else return open(next);
    }
    refresh();
  });
}

function begin() {
  document.title = `${data.file} · review`;
  const last = data.from + data.scenarios.length - 1;
  $("file").textContent = data.scenarios.length < data.total ? `${data.file} (${data.from}–${last} of ${data.total})` : data.file;
  options($("state"), queue.STATES, "state");
  options($("category"), queue.CHOICES, "category");
  listen(table(act));
  $("help").addEventListener("click", () => $("help").close());
  $("help-button").onclick = act.help;
  $("reviewer").onclick = name;
  $("export").onclick = act.exportAll;
  $("previous").onclick = () => step(-1);
  $("next").onclick = () => step(1);
  $("play").onclick = act.play;
  $("speed").onclick = act.speed;
  panel.legend($("legend"));
  onChange(() => {
    Object.values(views).forEach((view) => view.road.forget());
    panel.legend($("legend"));
    if (scenario) refreshPanel();
  });
  decisions.onChange(() => scenario && refresh());
  Object.values(views).forEach((view) => view.resize());
  requestAnimationFrame(tick);
  // The scenario shown before a reload, else the first undecided one.
  const shown = new URLSearchParams(location.hash.slice(1)).get("scenario");
  const index = shown ? find(shown) : data.scenarios.findIndex((entry) => !decisions.decision(entry.id));
  open(Math.max(0, index));
}

begin();
