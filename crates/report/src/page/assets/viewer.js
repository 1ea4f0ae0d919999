// The viewer: one or two simulators on the same scenario at the same time.

import { Camera } from "./camera.js";
import { Chart, seekable } from "./curves.js";
import { counted, ownMetrics, runs, scenarios, score, subjects } from "./data.js";
import { USUAL } from "./decode.js";
import { $, el, save, saveBlob, toast } from "./dom.js";
import { seconds } from "./format.js";
import { NO_RISK, RISKY, between } from "./geometry.js";
import { mark, neighbour } from "./list.js";
import { LOOKS } from "./painter.js";
import { colour, onChange } from "./palette.js";
import { Pane } from "./pane.js";
import * as panel from "./panel.js";
import { drawable, load } from "./scenes.js";
import { strip, times } from "./strip.js";

/** Number of frames for which the last frame is held before the replay restarts. */
const HOLD = 8;
const SPEEDS = [0.25, 0.5, 1, 2, 4];
const LAYERS = [
  ["map", "map"], ["lanes", "lane directions"], ["lights", "lights"], ["ghosts", "log as ghosts"], ["trails", "trails"], ["plan", "last plan"], ["context", "other recorded agents"], ["ids", "ids"],
];
const INKS = ["accent", "lateral"];

const camera = new Camera();
const layers = { map: true, lanes: true, lights: true, ghosts: true, trails: true, plan: true, context: true, ids: false };
let scene = null, index = null, wanted = null, chosen = null;
let time = USUAL.now, isPlaying = false, speed = 1, follow = false, isDirty = false;
let panes = [], charts = {};
/** Called when the address should change. */
let onState = () => {};

/** The name of a subject in addresses. */
const key = (i) => (runs.length > 1 ? `${subjects[i].id}@${runs[subjects[i].run].name}` : subjects[i].id);
export const byKey = (text) => subjects.findIndex((s) => key(s.index) === text);

/** The state of the viewer, for the address. */
export function state() {
  return index === null ? null : { scenario: scenarios.id[index], t: ((time - scene.now) / 10).toFixed(1), left: key(panes[0].subject), right: panes[1].subject === null ? "" : key(panes[1].subject) };
}

const replanOf = (i) => subjects[i].settings.replan_steps || 80;

/** Shows a scenario; simulators and time are kept unless given. */
export async function show(i, { t = null, left = null, right = undefined } = {}) {
  wanted = i;
  if (!drawable(i)) {
    scene = null;
    index = null;
    mark(i);
    $("stage").hidden = true;
    $("stage-note").hidden = false;
    $("stage-note").textContent = `${scenarios.id[i]} has no scene here. ${$("stage-note").dataset.lacks || "Create the page with --all, or open the runs with `reactsim view`."}`;
    return;
  }
  let loaded;
  try {
    loaded = await load(i);
  } catch (error) {
    toast(`${scenarios.id[i]} cannot be shown: ${error.message}`);
    return;
  }
  if (wanted !== i) return;
  $("stage").hidden = false;
  $("stage-note").hidden = true;
  [scene, index, chosen] = [loaded, i, null];
  mark(i);
  if (left !== null && left >= 0) panes[0].subject = left;
  if (right !== undefined) panes[1].subject = right !== null && right >= 0 ? right : null;
  propose();
  time = t === null ? scene.now : Math.min(last(), Math.max(scene.now, scene.now + 10 * t));
  $("timeline").setAttribute("aria-valuemin", String(-scene.now / 10));
  $("timeline").setAttribute("aria-valuemax", String((last() - scene.now) / 10));
  $("scene-id").textContent = scenarios.id[i];
  $("scene-about").textContent = [scenarios.category[i] && `${scenarios.category[i]} deviation`, scenarios.difficulty[i] && `${scenarios.difficulty[i]} conflict`, scene.source].filter(Boolean).join(" · ");
  refresh();
  resize();
  fit();
  document.body.dataset.scenario = i;
  onState();
}

/** The two simulators between which the score of a planner differs most, the worse one first; null if none differ. */
function verdicts(there) {
  const judged = there.filter((s) => s.planner && score(s.index, index) !== null);
  const planned = judged.filter((s) => s.planner !== "log");
  const scored = planned.length ? planned : judged;
  const pairs = scored.flatMap((a) => scored.filter((b) => b.run === a.run).map((b) => [score(b.index, index) - score(a.index, index), a.index, b.index]));
  const [most, ...pair] = pairs.reduce((a, b) => (b[0] > a[0] ? b : a), [0]);
  return most > 0 ? pair : null;
}

/** Without a choice, selects two contrasting simulators: one that hits the AV and one that does not, which can react. */
function propose() {
  if (panes[0].subject !== null) return;
  const there = subjects.filter((s) => scene.subjects.has(s.index));
  const pair = verdicts(there);
  if (pair) {
    [panes[0].subject, panes[1].subject] = pair;
    return;
  }
  const hits = (s) => counted(s.index, "aav-collision", index);
  const bad = there.filter((s) => hits(s) > 0), good = there.filter((s) => !hits(s) && !s.oracle);
  panes[0].subject = (bad[0] ?? there[0] ?? subjects[0]).index;
  const other = good.filter((s) => s.index !== panes[0].subject);
  panes[1].subject = (other.findLast((s) => s.reacts) ?? other[other.length - 1] ?? there.find((s) => s.index !== panes[0].subject) ?? null)?.index ?? null;
}

/** Fits the view to the AV's path and the agents in its events. */
function fit() {
  if (!scene) return;
  const points = [];
  for (const pane of panes) {
    const part = pane.part(scene);
    if (!part) continue;
    points.push(...part.tracks[0]);
    for (const e of part.events) if (e.metric.startsWith("aav-")) points.push(part.tracks[e.agent][Math.max(scene.now, e.from - 15)]);
  }
  camera.fit(points.filter(Boolean));
  camera.scale = Math.max(camera.scale, 2.2);
  isDirty = true;
}

function resize() {
  const changed = panes.map((pane) => !pane.root.hidden && pane.resize()).some(Boolean);
  if (changed) isDirty = true;
  return changed;
}

// ---- time

/** The last frame. */
const last = () => (scene ?? USUAL).frames - 1;

export function seek(frame) {
  time = Math.min(last(), Math.max(0, frame));
  setPlaying(false);
}

function setPlaying(value) {
  isPlaying = value;
  if (isPlaying && time >= last()) time = (scene ?? USUAL).now;
  $("play").textContent = isPlaying ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", isPlaying ? "pause" : "play");
  isDirty = true;
  if (!isPlaying) onState();
}

let before = 0;
function tick(now) {
  const passed = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (scene && !$("stage").hidden) {
    if (isPlaying) {
      time += passed * 10 * speed;
      if (time > last() + HOLD) time = scene.now;
      isDirty = true;
    }
    resize();
    if (isDirty) {
      isDirty = false;
      draw();
    }
  }
  requestAnimationFrame(tick);
}

function draw() {
  const t = Math.min(time, last());
  const first = panes.map((p) => p.part(scene)).find(Boolean);
  const av = first && between(first.tracks[0], t);
  if (follow && av) [camera.x, camera.y] = [av.x, av.y];
  for (const pane of panes) if (!pane.root.hidden) pane.draw(scene, t, layers, chosen);
  $("time").textContent = seconds(t, scene.now);
  $("timeline").setAttribute("aria-valuenow", ((t - scene.now) / 10).toFixed(1));
  const parts = panes.map((p) => p.part(scene));
  panel.timeline($("timeline"), scene, parts, t);
  panel.now($("now"), scene, parts, Math.min(Math.round(t), last()));
  const curves = (values) => parts.map((p, i) => p && { name: i ? "right" : "left", values: values(p), colour: colour(INKS[i]), dashed: i > 0 }).filter(Boolean);
  const of = chosen ?? 0;
  charts.speed.title = of === 0 ? "AV speed" : `Speed of ${scene.agents[of].id.slice(0, 14)}`;
  charts.speed.draw([...curves((p) => p.tracks[of].map((s) => s?.v ?? NaN)), { name: "log", values: scene.agents[of].track.map((s) => s?.v ?? NaN), colour: colour("dim"), dashed: true }], t, scene);
  charts.ttc.draw(curves((p) => p.analysis.ttc.map((v) => v ?? NaN)), t, scene);
  charts.gap.draw(curves((p) => p.analysis.gap.map((v) => v ?? NaN)), t, scene);
}

/** Updates everything that does not change with time. */
function refresh() {
  panes.forEach((pane) => (pane.select.value = pane.subject ?? ""));
  panes[1].root.hidden = panes[1].subject === null;
  $("panes").classList.toggle("two", panes[1].subject !== null);
  panel.facts($("now"), panes.map((p) => p.subject), index);
  panel.events($("events"), scene, panes.map((p) => p.part(scene)), panes[1].subject !== null, (event) => {
    chosen = event.agent;
    seek(event.from);
    approach(event);
  });
  isDirty = true;
}

/** Moves the view to an event, close enough to see who touches whom. */
function approach(event) {
  const tracks = panes[event.pane].part(scene).tracks;
  const points = [event.agent, event.partner].filter((i) => i !== undefined).map((i) => tracks[i][event.from]).filter(Boolean);
  setFollow(false);
  camera.fit(points);
}

// ---- pointer

const hub = {
  choose(pane, subject) {
    panes[pane].subject = subject;
    if (!scene) return;
    refresh();
    onState();
  },
  zoom(factor, x, y) {
    camera.zoom(factor, x, y);
    isDirty = true;
  },
  pan(dx, dy) {
    setFollow(false);
    camera.pan(dx, dy);
    isDirty = true;
  },
  pick(pane, x, y) {
    if (!scene) return;
    chosen = pane.at(scene, Math.min(time, last()), x, y);
    isDirty = true;
  },
  hover(pane, x, y, cx, cy) {
    const tip = $("tip");
    const i = pane && scene ? pane.at(scene, Math.min(time, last()), x, y) : null;
    tip.hidden = i === null;
    if (i === null) return;
    panel.agent(tip, scene, pane.part(scene), i, Math.min(Math.round(time), last()));
    tip.style.left = `${Math.min(cx + 14, innerWidth - tip.offsetWidth - 8)}px`;
    tip.style.top = `${Math.min(cy + 14, innerHeight - tip.offsetHeight - 8)}px`;
  },
};

function setFollow(value) {
  follow = value;
  $("follow").setAttribute("aria-pressed", String(follow));
  isDirty = true;
}

/** Moves to the next or the previous event. */
function toEvent(direction) {
  const all = [...new Set(panes.flatMap((p) => (scene && p.part(scene)?.events.filter((e) => panel.eventKind(e)).map((e) => e.from)) ?? []))].sort((a, b) => a - b);
  const f = Math.round(time);
  const next = direction > 0 ? all.find((e) => e > f) : all.findLast((e) => e < f);
  if (next === undefined) toast(direction > 0 ? "no later event" : "no earlier event");
  else seek(next);
}

function step(direction) {
  const next = neighbour(direction);
  if (next === null) toast(direction > 0 ? "no later scenario in the list" : "no earlier scenario in the list");
  else show(next);
}

function saveStrip() {
  const end = (last() - (scene ?? USUAL).now) / 10;
  const at = times($("strip-times").value, end);
  if (!at) return toast(`write up to 12 times between 0 and ${end} s, such as 0, 2, 4, 6`);
  const rows = panes.map((p) => p.subject).filter((s) => s !== null);
  save(fileName("svg"), strip(scene, rows, at, camera, follow, layers, replanOf), "image/svg+xml");
}

/** The views side by side as one canvas, with the names of the simulators above them. */
function picture() {
  const shown = panes.filter((p) => !p.root.hidden);
  const ratio = devicePixelRatio || 1, head = Math.round(26 * ratio);
  const canvas = el("canvas", {});
  // Encoders of video need even sizes.
  const even = (n) => n - (n % 2);
  canvas.width = even(shown.reduce((sum, p) => sum + p.canvas.width, 0));
  canvas.height = even(Math.max(...shown.map((p) => p.canvas.height)) + head);
  const context = canvas.getContext("2d", { alpha: false });
  const paint = () => {
    context.fillStyle = colour("panel");
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.fillStyle = colour("text");
    context.font = `${14 * ratio}px system-ui, sans-serif`;
    let x = 0;
    for (const pane of shown) {
      context.fillText(`${subjects[pane.subject].name} · ${$("time").textContent}`, x + 10 * ratio, 18 * ratio);
      context.drawImage(pane.canvas, x, head);
      x += pane.canvas.width;
    }
  };
  paint();
  return [canvas, paint];
}

const fileName = (ending) => `${scenarios.id[index].replace(/[^\w.-]+/g, "_")}.${ending}`;

function savePicture() {
  if (!scene) return;
  picture()[0].toBlob((blob) => saveBlob(fileName("png"), blob));
}

let recorder = null;

/** Plays from step 0 to the end and saves what is shown as a video; a second call ends it. */
function saveVideo() {
  if (!scene) return;
  if (recorder) return recorder.stop();
  const kind = ["video/mp4", "video/webm"].find((type) => window.MediaRecorder?.isTypeSupported(type));
  if (!kind) return toast("this browser cannot record videos");
  const [canvas, paint] = picture();
  const parts = [];
  recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: kind, videoBitsPerSecond: 8e6 });
  recorder.ondataavailable = (event) => parts.push(event.data);
  recorder.onstop = () => {
    recorder = null;
    $("video-save").textContent = "save video";
    setPlaying(false);
    saveBlob(fileName(kind.slice(6)), new Blob(parts, { type: kind }));
  };
  const follow_ = () => {
    if (!recorder) return;
    paint();
    if (isPlaying && time < last()) requestAnimationFrame(follow_);
    else recorder.stop();
  };
  $("video-save").textContent = "stop";
  seek(scene.now);
  setPlaying(true);
  recorder.start();
  requestAnimationFrame(follow_);
}

/** Key bindings: names of keys, description, action. */
export const KEYS = [
  [[" "], "play or pause", () => setPlaying(!isPlaying)],
  [["ArrowLeft"], "previous frame", () => seek(Math.round(time) - 1)],
  [["ArrowRight"], "next frame", () => seek(Math.round(time) + 1)],
  [["shift ArrowLeft"], "back one second", () => seek(Math.round(time) - 10)],
  [["shift ArrowRight"], "forward one second", () => seek(Math.round(time) + 10)],
  [["0"], "to step 0", () => seek(scene.now)],
  [["["], "previous event", () => toEvent(-1)],
  [["]"], "next event", () => toEvent(1)],
  [["n"], "next scenario of the list", () => step(1)],
  [["p"], "previous scenario of the list", () => step(-1)],
  [["<"], "slower", () => faster(-1)],
  [[">"], "faster", () => faster(1)],
  [["v"], "follow the AV", () => setFollow(!follow)],
  [["r"], "show everything", () => (setFollow(false), fit())],
  [["+", "="], "zoom in", () => hub.zoom(1.25)],
  [["-"], "zoom out", () => hub.zoom(0.8)],
  [["g"], "the log as ghosts", () => toggle("ghosts")],
  [["i"], "ids", () => toggle("ids")],
];

function faster(by) {
  speed = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, SPEEDS.indexOf(speed) + by))];
  $("speed").value = speed;
}

function toggle(layer) {
  layers[layer] = !layers[layer];
  $(`layer-${layer}`).checked = layers[layer];
  isDirty = true;
}

/** Handles a key. Returns whether it is one of KEYS. */
export function press(event) {
  if (!scene) return false;
  const name = event.shiftKey && event.key.startsWith("Arrow") ? `shift ${event.key}` : event.key;
  const found = KEYS.find(([names]) => names.includes(name));
  found?.[2]();
  return !!found;
}

/** Creates the viewer. */
export function viewer(changed) {
  onState = changed;
  panes = [0, 1].map((i) => new Pane(i, camera, hub, i > 0));
  $("panes").replaceChildren(...panes.map((p) => p.root));
  const seekable_ = (canvas) => seekable(canvas, (x, width) => ((x - 8) / (width - 16)) * last(), (f) => {
    // Snap to a nearby mark.
    const marks = panes.flatMap((p) => (scene && p.part(scene)?.events.filter((e) => panel.eventKind(e))) ?? []);
    const near = marks.filter((e) => Math.abs(e.from - f) < 0.8).sort((a, b) => Math.abs(a.from - f) - Math.abs(b.from - f))[0];
    seek(near ? near.from : Math.round(f));
  });
  seekable_($("timeline"));
  const chart = (id, about) => new Chart($(id), about, (f) => seek(Math.round(f)));
  charts = {
    speed: chart("chart-speed", { title: "Speed", unit: "m/s", floor: 5 }),
    ttc: chart("chart-ttc", { title: "Time to collision", unit: "s", top: NO_RISK, line: RISKY, cap: NO_RISK }),
    gap: chart("chart-gap", { title: "Nearest agent", unit: "m", top: 15 }),
  };
  $("layers").replaceChildren(...LAYERS.map(([name, label]) => el("label", {}, el("input", { type: "checkbox", id: `layer-${name}`, checked: layers[name], onchange: () => {
    layers[name] = $(`layer-${name}`).checked;
    isDirty = true;
  } }), label)));
  $("legend").replaceChildren(
    el("li", {}, el("i", { class: "dot av" }), "AV"), el("li", {}, el("i", { class: "dot vehicle" }), "vehicle"), el("li", {}, el("i", { class: "dot pedestrian" }), "pedestrian"), el("li", {}, el("i", { class: "dot cyclist" }), "cyclist"), el("li", {}, el("i", { class: "dot ghost" }), "log"),
    ...Object.entries(LOOKS).filter(([kind]) => (kind !== "own" || ownMetrics.length) && kind !== "av").map(([kind, look]) => el("li", {}, el("i", { class: `dot ${kind}` }), look.name)));
  $("speed").replaceChildren(...SPEEDS.map((s) => el("option", { value: s }, `${s}×`)));
  $("speed").value = speed;
  $("speed").onchange = () => (speed = Number($("speed").value));
  $("play").onclick = () => setPlaying(!isPlaying);
  $("back").onclick = () => seek(Math.round(time) - 1);
  $("on").onclick = () => seek(Math.round(time) + 1);
  $("event-before").onclick = () => toEvent(-1);
  $("event-next").onclick = () => toEvent(1);
  $("previous").onclick = () => step(-1);
  $("next").onclick = () => step(1);
  $("follow").onclick = () => setFollow(!follow);
  $("fit").onclick = () => (setFollow(false), fit());
  $("strip-save").onclick = saveStrip;
  $("picture-save").onclick = savePicture;
  $("video-save").onclick = saveVideo;
  $("timeline").addEventListener("keydown", (event) => {
    const to = { Home: (scene ?? USUAL).now, End: last() }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    seek(to);
  });
  onChange(() => {
    panes.forEach((p) => p.road.forget());
    isDirty = true;
  });
  requestAnimationFrame(tick);
}
