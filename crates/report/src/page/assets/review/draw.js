// The scenario from above. World coordinates are metres with y up; line widths are metres for the road,
// pixels elsewhere.

import { box, lights, names, ruler } from "./bodies.js";
import { between } from "./geometry.js";
import { colour } from "./palette.js";
import { Road } from "./road.js";

export class View {
  road = new Road();
  labels = [];

  constructor(canvas, camera) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.camera = camera;
  }

  /** Adopts the size of the element; returns whether it changed. */
  resize() {
    this.ratio = devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    const [width, height] = [Math.round(clientWidth * this.ratio), Math.round(clientHeight * this.ratio)];
    if (width === this.canvas.width && height === this.canvas.height) return false;
    [this.canvas.width, this.canvas.height] = [width, height];
    [this.camera.width, this.camera.height] = [clientWidth, clientHeight];
    return true;
  }

  /**
   * Draws `scenario` at frame `t` with the selected candidate, or with the logged AV if it is null. Flags of
   * `show`: responses of the candidate's certificate replace the logs (`certificate`); the other candidates are
   * visible (`others`).
   */
  draw(scenario, selected, analysis, t, show) {
    const c = this.context, { camera, ratio } = this;
    this.labels = [];
    this.road.draw(c, scenario.map, camera, ratio);
    const s = camera.scale * ratio;
    const [dx, dy] = [(camera.width / 2) * ratio - camera.x * s, (camera.height / 2) * ratio + camera.y * s];
    c.setTransform(s, 0, 0, -s, dx, dy);
    c.lineJoin = "round";
    const px = 1 / camera.scale;
    const f = Math.min(Math.round(t), scenario.frames - 1);
    lights(c, scenario.map, f, px);
    this.trajectories(scenario, selected, show, px);
    for (const agent of scenario.context) this.agent(agent, between(agent.track, t), px, { alpha: 0.5 });
    const touching = analysis?.touching[f] ?? new Set(), risky = analysis?.risky[f] ?? new Set();
    // Agents in contact or at risk are drawn on top.
    const order = scenario.agents.map((_, i) => i).slice(1);
    order.sort((a, b) => touching.has(a) - touching.has(b) || risky.has(a) - risky.has(b));
    for (const i of order) {
      const agent = scenario.agents[i];
      const response = show.certificate ? selected?.responses.get(i) : null;
      if (response) this.agent(agent, between(agent.track, t), px, { ghost: true });
      const mark = touching.has(i) ? "contact" : risky.has(i) ? "risky" : response ? "response" : null;
      const fill = mark && colour(mark);
      const state = between(response ? response.frames : agent.track, t);
      const strong = risky.has(i) || touching.has(i) ? colour("contact") : null;
      this.agent(agent, state, px, { fill, strong, label: fill ? agent.id : null });
    }
    const av = scenario.agents[0];
    if (selected) {
      this.agent(av, between(av.track, t), px, { ghost: true });
      const isHit = touching.size > 0;
      const strong = isHit ? colour("contact") : colour("text");
      const style = { fill: colour(selected.category), strong, label: "AV" };
      this.agent(av, between(selected.frames, t), px, style);
      for (const at of analysis?.first.values() ?? []) this.contact(selected.frames[at], px);
    } else {
      const style = { fill: colour("accent"), strong: colour("text"), label: "AV" };
      this.agent(av, between(av.track, t), px, style);
    }
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    names(c, this.labels);
    ruler(c, camera);
  }

  /** Draws the log, and all candidates: survivors solid, rejected dashed, the selected one wide with a dot per second. */
  trajectories(scenario, selected, show, px) {
    const c = this.context, { now } = scenario;
    const line = (frames, from) => {
      c.beginPath();
      let open = false;
      for (let f = from; f < frames.length; f++) {
        const s = frames[f];
        if (s) c[open ? "lineTo" : "moveTo"](s.x, s.y);
        open = !!s;
      }
      c.stroke();
    };
    c.lineCap = "round";
    if (selected && show.others) {
      for (const candidate of [...scenario.candidates].reverse()) {
        if (candidate === selected) continue;
        c.strokeStyle = colour(candidate.category);
        c.globalAlpha = candidate.rejected_by ? 0.45 : 0.85;
        c.lineWidth = (candidate.rejected_by ? 1 : 1.8) * px;
        c.setLineDash(candidate.rejected_by ? [4 * px, 5 * px] : []);
        line(candidate.frames, now);
      }
    }
    c.globalAlpha = 1;
    c.setLineDash(selected ? [2 * px, 4 * px] : []);
    c.strokeStyle = colour(selected ? "ghost" : "accent");
    c.lineWidth = 1.6 * px;
    line(scenario.agents[0].track, 0);
    c.setLineDash([]);
    if (selected) {
      c.strokeStyle = colour(selected.category);
      c.globalAlpha = 0.35;
      c.lineWidth = 8 * px;
      line(selected.frames, now);
      c.globalAlpha = 1;
      c.lineWidth = 2.6 * px;
      c.setLineDash(selected.rejected_by ? [7 * px, 6 * px] : []);
      line(selected.frames, now);
      c.setLineDash([]);
      c.fillStyle = colour(selected.category);
      for (let f = now + 10; f < scenario.frames; f += 10) {
        const s = selected.frames[f];
        if (!s) continue;
        c.beginPath();
        c.arc(s.x, s.y, 3 * px, 0, 7);
        c.fill();
      }
      if (show.certificate) {
        c.strokeStyle = colour("response");
        c.lineWidth = 2 * px;
        for (const response of selected.responses.values()) line(response.frames, now);
      }
    }
  }

  /** Draws a box with its heading; `strong` is the colour of a thick outline. */
  agent(agent, state, px, { fill = null, ghost = false, strong = null, alpha = 1, label = null } = {}) {
    const style = { fill, ghost, line: strong, width: strong ? 2.2 : 1, alpha, label };
    box(this.context, this.camera, agent, state, px, style, this.labels);
  }

  /** Marks the AV's position at the first contact with an agent. */
  contact(state, px) {
    const c = this.context, r = 5 * px;
    c.strokeStyle = colour("contact");
    c.lineWidth = 2 * px;
    c.beginPath();
    c.moveTo(state.x - r, state.y - r);
    c.lineTo(state.x + r, state.y + r);
    c.moveTo(state.x - r, state.y + r);
    c.lineTo(state.x + r, state.y - r);
    c.stroke();
  }
}
