// Bird's-eye view of a rollout. World coordinates are metres with y up; line widths are metres for the
// road, pixels elsewhere. States differ in outline as well as in colour.

import { between } from "./geometry.js";
import { box, lights, names, ruler } from "./bodies.js";
import { colour } from "./palette.js";
import { paintMap } from "./road.js";

/** Distance in metres between realised and logged position above which the log is drawn as a ghost. */
const GHOST_DISTANCE = 0.5;
/** Number of frames of the trail behind an agent. */
const TRAIL = 30;

/** Styles of states: fill, outline, width of the outline in pixels, dashes, and whether it has a ring. */
export const LOOKS = {
  fault: { name: "at fault", fill: "fault", line: "text", width: 2.6, dash: [], ring: true },
  contact: { name: "colliding", fill: "contact", line: "text", width: 2.6, dash: [], ring: false },
  risky: { name: "risky", fill: "risky", line: "text", width: 2, dash: [4, 2.5], ring: false },
  offroad: { name: "off-road", fill: "offroad", line: "offroad", width: 2, dash: [1.5, 2.5], ring: false },
  against: { name: "against the lane", fill: "pedestrian", line: "text", width: 2, dash: [7, 3, 1.5, 3], ring: false },
  red: { name: "running a red light", fill: "fault", line: "fault", width: 2, dash: [3, 2, 1, 2], ring: false },
  av: { name: "event of a metric of the AV", fill: "av", line: "text", width: 2, dash: [], ring: false },
  own: { name: "event of another metric", fill: "accent", line: "accent", width: 2, dash: [2, 2], ring: false },
};

/** Sets the transform to world coordinates; `ratio` is device pixels per CSS pixel. */
function world(c, camera, ratio) {
  const s = camera.scale * ratio;
  c.setTransform(s, 0, 0, -s, (camera.width / 2 - camera.x * camera.scale) * ratio, (camera.height / 2 + camera.y * camera.scale) * ratio);
}

/**
 * Paints a scene: `subject` holds the rollout of a simulator (tracks, states), `t` is the fractional
 * frame, `layers` are the visible layers, `replan` is the number of steps between two plans. `ground`
 * paints the road; without it the road is painted directly.
 */
export function paint(c, scene, subject, camera, t, layers, { ratio = 1, replan = 5, ground = null, chosen = null } = {}) {
  const px = 1 / camera.scale;
  const f = Math.min(Math.round(t), scene.frames - 1);
  if (ground) ground(c, layers.map ? scene.map : null);
  else {
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = colour("ground");
    c.fillRect(0, 0, camera.width, camera.height);
    world(c, camera, ratio);
    if (layers.map) paintMap(c, scene.map, camera.scale);
  }
  world(c, camera, ratio);
  c.lineJoin = "round";
  c.lineCap = "round";
  c.globalAlpha = 1;
  if (layers.lanes) arrows(c, scene.map, px);
  if (layers.lights) lights(c, scene.map, f, px);
  const labels = [];
  const body = (agent, state, look) => box(c, camera, agent, state, px, look, labels);
  if (layers.context) for (const agent of scene.context) body(agent, between(agent.track, t), { alpha: 0.5 });
  const { tracks, states } = subject;
  const isDisplaced = (i) => tracks[i].some((s, k) => s && scene.agents[i].track[k] && Math.hypot(s.x - scene.agents[i].track[k].x, s.y - scene.agents[i].track[k].y) > GHOST_DISTANCE);
  const order = scene.agents.map((_, i) => i).slice(1).sort((a, b) => !!states[a][f] - !!states[b][f]);
  if (layers.trails) for (const i of [...order, 0]) trail(c, tracks[i], f, px, i === 0 ? "av" : scene.agents[i].kind, i === 0 ? 3 : 1.6);
  if (layers.plan) plan(c, tracks, order, f, scene.now, replan, px);
  if (layers.ghosts) {
    for (const i of [...order, 0]) {
      if (!isDisplaced(i)) continue;
      loggedPath(c, scene.agents[i].track, scene.now, px, i === 0);
      body(scene.agents[i], between(scene.agents[i].track, t), { ghost: true });
    }
  }
  for (const i of order) {
    const agent = scene.agents[i], look = LOOKS[states[i][f]];
    const label = look || layers.ids || i === chosen ? agent.id : null;
    const ring = look?.ring ? colour("fault") : i === chosen ? colour("accent") : null;
    body(agent, between(tracks[i], t), look ? { fill: colour(look.fill), line: colour(look.line), width: look.width, dash: look.dash, ring, label } : { ring, label });
  }
  const isHit = [...(subject.analysis.touching[f] ?? [])].length > 0;
  // The AV's label is below it, so that it does not cover labels of agents that touch it.
  body(scene.agents[0], between(tracks[0], t), { fill: colour("av"), line: colour(isHit ? "fault" : "text"), width: 2.2, ring: chosen === 0 ? colour("accent") : null, label: "AV", below: true });
  c.globalAlpha = 1;
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  names(c, labels);
  ruler(c, camera);
}

/** Arrows of the lane directions, at equal distances along centre lines. */
function arrows(c, map, px) {
  c.strokeStyle = colour("center");
  c.lineWidth = 1.2 * px;
  c.stroke(map.arrows);
}

function line(c, track, from, to) {
  c.beginPath();
  let open = false;
  for (let f = Math.max(0, from); f <= Math.min(to, track.length - 1); f++) {
    const s = track[f];
    if (s) c[open ? "lineTo" : "moveTo"](s.x, s.y);
    open = !!s;
  }
  c.stroke();
}

/** The track of the last seconds, paler with age. */
function trail(c, track, f, px, ink, width) {
  const [a, b] = [track[Math.max(0, f - TRAIL)], track[f]];
  if (a && b && Math.hypot(a.x - b.x, a.y - b.y) < 0.5) return;
  c.strokeStyle = colour(ink);
  c.lineWidth = width * px;
  for (let k = 3; k > 0; k--) {
    c.globalAlpha = 0.25 * (4 - k);
    line(c, track, f - k * (TRAIL / 3), f - (k - 1) * (TRAIL / 3));
  }
  c.globalAlpha = 1;
}

/** The current plan, made at the last replanning step. It is as long as the interval and executed exactly. */
function plan(c, tracks, order, f, now, replan, px) {
  if (f < now) return;
  const made = now + Math.floor((f - now) / replan) * replan;
  c.strokeStyle = colour("accent");
  c.lineWidth = 2.4 * px;
  c.globalAlpha = 0.8;
  for (const i of order) {
    const [a, b] = [tracks[i][made], tracks[i][Math.min(made + replan, tracks[i].length - 1)]];
    if (a && b && Math.hypot(a.x - b.x, a.y - b.y) > 0.2) line(c, tracks[i], made, made + replan);
  }
  c.globalAlpha = 1;
}

/** The logged path. */
function loggedPath(c, track, now, px, isAv) {
  c.strokeStyle = colour(isAv ? "av" : "ghost");
  c.globalAlpha = isAv ? 0.8 : 0.45;
  c.lineWidth = (isAv ? 1.6 : 1) * px;
  c.setLineDash([3 * px, 4 * px]);
  line(c, track, now, track.length - 1);
  c.setLineDash([]);
  c.globalAlpha = 1;
}
