// The first screen: one scenario in which a simulator hits the AV and another one does not, or in which the verdict on a
// planner depends on the simulator, side by side.

import { Camera } from "./camera.js";
import { data, metric, scenarios, subjects, value } from "./data.js";
import { $, el, toast } from "./dom.js";
import { number, seconds } from "./format.js";
import { between } from "./geometry.js";
import { paint } from "./painter.js";
import { onChange } from "./palette.js";
import { Road } from "./road.js";
import { load } from "./scenes.js";

const LAYERS = { map: true, lanes: false, lights: true, ghosts: true, trails: true, plan: false, context: true, ids: false };
/** Frames shown before and after the collision, and for which the last frame is held. */
const BEFORE = 30, AFTER = 15, HOLD = 12;
/** Magnification of the view that has the usual margins. */
const CLOSER = 1.5;
/** Frames per second. */
const RATE = 10;

/** One side: a simulator on the scene. */
class Side {
  road = new Road();
  camera = new Camera();

  constructor(subject, scene) {
    [this.subject, this.scene, this.part] = [subject, scene, scene.subjects.get(subject.index)];
    this.canvas = el("canvas", { role: "img", "aria-label": `${subject.name} from above` });
    this.context = this.canvas.getContext("2d", { alpha: false });
    this.root = el("div", {}, el("strong", {}, subject.name), this.canvas);
  }

  draw(points, frame) {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== h) [this.canvas.width, this.canvas.height] = [w, h];
    [this.camera.width, this.camera.height] = [width, height];
    this.camera.fit(points);
    this.camera.scale *= CLOSER;
    paint(this.context, this.scene, this.part, this.camera, frame, LAYERS, { ratio, replan: this.subject.settings.replan_steps || 80, ground: (c, map) => this.road.draw(c, map, this.camera, ratio) });
  }
}

/** What the traffic changes for a planner. */
function verdict(scenario, worse, better, hit, scene) {
  const id = ["av-score", "av-score-partial"].find((id) => value(worse.index, id, scenario) !== null && value(better.index, id, scenario) !== null);
  const of = (s) => `${number(metric(id), value(s.index, id, scenario))} among ${s.title}`;
  const why = hit.metric ? ` (${metric(hit.metric).title} violated at ${seconds(hit.from, scene.now)})` : "";
  return `The traffic changes the verdict on ${worse.planner}: its ${metric(id).title} is ${of(worse)}${why} and ${of(better)}.`;
}

/** Shows the leading scenario; `open` is called with it, the time of the collision in seconds, and both simulators. */
export async function lead(open) {
  if (!data.lead) return;
  const { scenario, left, right, judged } = data.lead;
  let scene;
  try {
    scene = await load(scenario);
  } catch (error) {
    toast(`${scenarios.id[scenario]} cannot be shown: ${error.message}`);
    return;
  }
  if (![left, right].every((i) => scene.subjects.has(i))) return;
  const sides = [left, right].map((i) => new Side(subjects[i], scene));
  const events = sides[0].part.events.filter((e) => e.counted);
  const collision = events.find((e) => e.metric === (judged ? "av-at-fault-collisions" : "aav-collision"));
  // A planner can also be worse without a collision.
  const hit = collision ?? (judged ? events.find((e) => metric(e.metric).av) ?? { from: scene.now + BEFORE, agent: 0 } : null);
  if (!hit) return;
  const first = Math.max(0, hit.from - BEFORE), last = Math.min(scene.frames - 1, hit.from + AFTER);
  // Both agents on their way to the collision, in both rollouts.
  const points = sides.flatMap(({ part }) => [0, hit.agent, hit.partner].filter((i) => i !== undefined).flatMap((i) => [first, hit.from, last].map((f) => between(part.tracks[i], f)))).filter(Boolean);
  const about = [scenarios.category[scenario] && `${scenarios.category[scenario]} deviation`, scenarios.difficulty[scenario] && `${scenarios.difficulty[scenario]} conflict`].filter(Boolean).join(", ");
  const time = (hit.from - scene.now) / 10;
  $("lead-panes").replaceChildren(...sides.map((side) => side.root));
  $("lead-about").replaceChildren(
    `${judged ? verdict(scenario, subjects[left], subjects[right], hit, scene) : `With ${subjects[left].name}, a vehicle hits the AV at ${seconds(hit.from, scene.now)}; with ${subjects[right].name}, none does.`} Dashed: the log. `,
    `Scenario ${scenarios.id[scenario]}${about && ` (${about})`}. `,
    el("button", { id: "lead-open", onclick: () => open(scenario, time, left, right) }, "open in the viewer"));
  $("lead").hidden = false;
  let frame = hit.from, isVisible = true;
  const draw = () => sides.forEach((side) => side.draw(points, Math.min(frame, last)));
  onChange(() => {
    for (const side of sides) side.road.forget();
    draw();
  });
  new ResizeObserver(draw).observe($("lead-panes"));
  draw();
  document.body.dataset.lead = scenario;
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
  new IntersectionObserver(([entry]) => (isVisible = entry.isIntersecting)).observe($("lead"));
  let before = performance.now();
  const tick = (now) => {
    const passed = Math.min((now - before) / 1000, 0.1);
    before = now;
    if (isVisible) {
      frame += passed * RATE;
      if (frame > last + HOLD) frame = first;
      draw();
    }
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}
