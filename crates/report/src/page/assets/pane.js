// One view of the scene: a simulator, its canvas, and pointer events.

import { runs, subjects } from "./data.js";
import { el } from "./dom.js";
import { between } from "./geometry.js";
import { paint } from "./painter.js";
import { Road } from "./road.js";

export class Pane {
  road = new Road();
  subject = null;

  /** `hub` receives choices and pointer events; `optional` panes may be empty. */
  constructor(number, camera, hub, optional) {
    this.camera = camera;
    this.canvas = el("canvas", { tabindex: "-1", "aria-label": "the scene from above" });
    this.context = this.canvas.getContext("2d", { alpha: false });
    this.select = el("select", { id: `pane-${number}`, "aria-label": `simulator ${number + 1}`, onchange: () => hub.choose(number, this.select.value === "" ? null : Number(this.select.value)) },
      optional ? el("option", { value: "" }, "– none –") : null,
      ...subjects.map((s) => el("option", { value: s.index }, s.name)));
    this.says = el("span", { class: "says" });
    this.root = el("div", { class: "pane" }, el("div", { class: "pane-head" }, this.select, this.says), this.canvas);
    this.listen(hub);
  }

  listen(hub) {
    const { canvas } = this;
    canvas.addEventListener("wheel", (event) => {
      // The wheel scrolls the page; zooming needs Ctrl, a pinch gesture, or a focused canvas.
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
      event.preventDefault();
      hub.zoom(Math.exp(-event.deltaY * 0.0018), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      this.moved = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) {
        this.moved += Math.hypot(event.movementX, event.movementY);
        if (this.moved > 3) hub.pan(event.movementX, event.movementY);
      } else hub.hover(this, event.offsetX, event.offsetY, event.clientX, event.clientY);
    });
    canvas.addEventListener("pointerup", (event) => {
      if (this.moved <= 3) hub.pick(this, event.offsetX, event.offsetY);
    });
    canvas.addEventListener("pointerleave", () => hub.hover(null));
  }

  /** Adopts the size of the element. Returns true if it changed. */
  resize() {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width === w && this.canvas.height === h && this.ratio === ratio) return false;
    [this.canvas.width, this.canvas.height, this.ratio] = [w, h, ratio];
    [this.camera.width, this.camera.height] = [width, height];
    return true;
  }

  /** The rollout of the simulator in a scene, or null. */
  part(scene) {
    return this.subject === null ? null : scene.subjects.get(this.subject) ?? null;
  }

  draw(scene, t, layers, chosen) {
    const part = this.part(scene);
    const { camera, context: c } = this;
    this.says.textContent = this.subject === null ? "" : part ? "" : "no rollout of this scenario";
    if (!part) {
      c.setTransform(1, 0, 0, 1, 0, 0);
      this.road.draw(c, scene.map, camera, this.ratio);
      return;
    }
    const replan = runs[subjects[this.subject].run].summary.provenance.settings.replan_steps || 80;
    paint(c, scene, part, camera, t, layers, { ratio: this.ratio, replan, chosen, ground: (context, map) => this.road.draw(context, map, camera, this.ratio) });
  }

  /** The smallest agent under a position of the canvas; null if there is none. */
  at(scene, t, px, py) {
    const part = this.part(scene);
    if (!part) return null;
    const [x, y] = this.camera.toWorld(px, py);
    const slack = 4 / this.camera.scale;
    let best = null, least = Infinity;
    scene.agents.forEach((agent, i) => {
      const s = between(part.tracks[i], t);
      if (!s) return;
      const [dx, dy, cos, sin] = [x - s.x, y - s.y, Math.cos(s.h), Math.sin(s.h)];
      const isIn = Math.abs(dx * cos + dy * sin) <= agent.length / 2 + slack && Math.abs(dy * cos - dx * sin) <= agent.width / 2 + slack;
      const size = agent.length * agent.width;
      if (isIn && size < least) [best, least] = [i, size];
    });
    return best;
  }
}
