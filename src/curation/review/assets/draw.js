// The scenario from above. World coordinates are metres with y up; line widths are metres where the road is drawn, pixels elsewhere.

import { FRAMES, NOW } from "./decode.js";
import { between } from "./geometry.js";
import { colour } from "./palette.js";

/** The codes of painted lines: broken, solid, double; yellow or white. */
const BROKEN = new Set([1, 4, 5]);
const YELLOW = new Set([4, 5, 6, 7, 8]);
const DOUBLE = new Set([3, 7, 8]);
/** Reach of the pale margin around centre lines where the map has no drivable area, metres. */
const SHOULDER = 2.9;
/** The picture of the road is this much larger than the view, so that it need not be drawn anew for every step of the camera. */
const SPARE = 1.6;

/** Keeps the road as a picture. */
class Road {
  canvas = document.createElement("canvas");
  context = this.canvas.getContext("2d");
  key = null;

  draw(ctx, map, camera, ratio) {
    const { width, height, scale } = camera;
    const fits = this.key && this.key.map === map && this.key.scale === scale && this.key.ratio === ratio &&
      this.key.width === width && this.key.height === height &&
      Math.abs(camera.x - this.key.x) * scale <= (width * (SPARE - 1)) / 2 && Math.abs(camera.y - this.key.y) * scale <= (height * (SPARE - 1)) / 2;
    if (!fits) {
      this.key = { map, scale, ratio, width, height, x: camera.x, y: camera.y };
      this.canvas.width = Math.ceil(width * SPARE * ratio);
      this.canvas.height = Math.ceil(height * SPARE * ratio);
      const s = scale * ratio;
      const c = this.context;
      c.setTransform(1, 0, 0, 1, 0, 0);
      c.fillStyle = colour("ground");
      c.fillRect(0, 0, this.canvas.width, this.canvas.height);
      c.setTransform(s, 0, 0, -s, this.canvas.width / 2 - camera.x * s, this.canvas.height / 2 + camera.y * s);
      if (map) paintMap(c, map, scale);
    }
    const dx = (this.key.x - camera.x) * scale * ratio, dy = (camera.y - this.key.y) * scale * ratio;
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.drawImage(this.canvas, Math.round((width * ratio - this.canvas.width) / 2 + dx), Math.round((height * ratio - this.canvas.height) / 2 + dy));
  }

  forget() {
    this.key = null;
  }
}

function paintMap(c, map, scale) {
  const px = 1 / scale;
  c.lineJoin = "round";
  c.fillStyle = colour("shoulder");
  c.fill(map.drivable, "evenodd");
  c.fillStyle = colour("driveway");
  c.fill(map.driveways);
  if (!map.hasArea) {
    c.lineCap = "round";
    c.lineWidth = 2 * SHOULDER;
    c.strokeStyle = colour("shoulder");
    c.stroke(map.centers);
  }
  c.lineCap = "butt";
  c.fillStyle = colour("road");
  c.fill(map.junctions);
  c.fill(map.laneAreas);
  for (const lane of map.corridors) {
    c.lineWidth = lane.width;
    c.strokeStyle = colour(lane.bike ? "bike" : "road");
    c.stroke(lane.path);
  }
  c.fillStyle = colour("bump");
  c.fill(map.bumps);
  for (const { area, stripes } of map.crosswalks) {
    c.save();
    c.clip(area);
    c.lineWidth = 0.55;
    c.strokeStyle = colour("crosswalk");
    c.stroke(stripes);
    c.restore();
  }
  c.lineWidth = Math.max(0.6 * px, 0.06);
  c.strokeStyle = colour("center");
  c.setLineDash([1.2, 1.8]);
  c.stroke(map.centers);
  for (const [kind, path] of map.paint) {
    c.setLineDash(BROKEN.has(kind) ? [3, 4] : []);
    c.strokeStyle = colour(YELLOW.has(kind) ? "yellow" : "paint");
    c.lineWidth = Math.max((DOUBLE.has(kind) ? 1.6 : 1) * px, DOUBLE.has(kind) ? 0.3 : 0.15);
    c.stroke(path);
  }
  c.setLineDash([]);
  c.strokeStyle = colour("edge");
  c.lineWidth = Math.max(1.2 * px, 0.15);
  c.stroke(map.edges);
  for (const [, path] of map.stops) {
    c.strokeStyle = colour("stop");
    c.lineWidth = Math.max(1.5 * px, 0.4);
    c.stroke(path);
  }
}

/** Red, yellow, green by the code of a light (0 to 8, `-` where not observed). */
const LIGHTS = { 1: "light-stop", 4: "light-stop", 7: "light-stop", 2: "light-caution", 5: "light-caution", 8: "light-caution", 3: "light-go", 6: "light-go" };

export class View {
  road = new Road();
  labels = [];

  constructor(canvas, camera) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.camera = camera;
  }

  /** Takes the size of the element; true where it changed. */
  resize() {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === this.camera.width && height === this.camera.height && ratio === this.ratio) return false;
    [this.camera.width, this.camera.height, this.ratio] = [width, height, ratio];
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    return true;
  }

  /**
   * Draws `scenario` at frame `t`. `show` says what: the selected candidate, whose responses replace the logs (`certificate`), whether
   * the log's AV (`ghost`) and the other candidates (`others`) are seen.
   */
  draw(scenario, selected, analysis, t, show) {
    const c = this.context, { camera, ratio } = this;
    this.labels = [];
    this.road.draw(c, scenario.map, camera, ratio);
    const s = camera.scale * ratio;
    c.setTransform(s, 0, 0, -s, (camera.width / 2) * ratio - camera.x * s, (camera.height / 2) * ratio + camera.y * s);
    c.lineJoin = "round";
    const px = 1 / camera.scale;
    const f = Math.min(Math.round(t), FRAMES - 1);
    this.lights(scenario, f, px);
    this.trajectories(scenario, selected, show, px);
    for (const agent of scenario.context) this.agent(agent, between(agent.track, t), px, { alpha: 0.5 });
    const touching = analysis?.touching[f] ?? new Set(), risky = analysis?.risky[f] ?? new Set();
    // Those who matter lie on top.
    const order = scenario.agents.map((_, i) => i).slice(1);
    order.sort((a, b) => touching.has(a) - touching.has(b) || risky.has(a) - risky.has(b));
    for (const i of order) {
      const agent = scenario.agents[i];
      const response = show.certificate ? selected?.responses.get(i) : null;
      if (response) this.agent(agent, between(agent.track, t), px, { ghost: true });
      const fill = touching.has(i) ? colour("contact") : risky.has(i) ? colour("risky") : response ? colour("response") : null;
      const state = between(response ? response.frames : agent.track, t);
      const strong = risky.has(i) || touching.has(i) ? colour("contact") : null;
      this.agent(agent, state, px, { fill, strong, label: fill ? agent.id : null });
    }
    const av = scenario.agents[0];
    if (show.ghost) this.agent(av, between(av.track, t), px, { ghost: true });
    if (selected) {
      const isHit = touching.size > 0;
      this.agent(av, between(selected.frames, t), px, { fill: colour(selected.category), strong: isHit ? colour("contact") : colour("text"), label: "AV" });
      for (const at of analysis?.first.values() ?? []) this.contact(selected.frames[at], px);
    } else {
      this.agent(av, between(av.track, t), px, { fill: colour("accent"), strong: colour("text"), label: "AV" });
    }
    // Names lie on top of all boxes.
    for (const [text, x, y] of this.labels) this.label(text, x, y);
    this.ruler();
  }

  lights(scenario, f, px) {
    const c = this.context;
    for (const light of scenario.map?.lights ?? []) {
      c.beginPath();
      c.arc(light.x, light.y, Math.max(0.75, 3 * px), 0, 7);
      c.fillStyle = colour(LIGHTS[light.states[f]] ?? "light-unknown");
      c.fill();
      c.lineWidth = px;
      c.strokeStyle = colour("ground");
      c.stroke();
    }
  }

  /** All candidates as lines: survivors solid, rejected ones thin and dashed; the selected one wide, with a dot every second. */
  trajectories(scenario, selected, show, px) {
    const c = this.context;
    const line = (frames, from) => {
      c.beginPath();
      let open = false;
      for (let f = from; f < FRAMES; f++) {
        const s = frames[f];
        if (s) c[open ? "lineTo" : "moveTo"](s.x, s.y);
        open = !!s;
      }
      c.stroke();
    };
    c.lineCap = "round";
    if (show.others) {
      for (const candidate of [...scenario.candidates].reverse()) {
        if (candidate === selected) continue;
        c.strokeStyle = colour(candidate.category);
        c.globalAlpha = candidate.rejected_by ? 0.45 : 0.85;
        c.lineWidth = (candidate.rejected_by ? 1 : 1.8) * px;
        c.setLineDash(candidate.rejected_by ? [4 * px, 5 * px] : []);
        line(candidate.frames, NOW);
      }
    }
    c.globalAlpha = 1;
    if (show.ghost) {
      c.setLineDash([2 * px, 4 * px]);
      c.strokeStyle = colour("ghost");
      c.lineWidth = 1.6 * px;
      line(scenario.agents[0].track, 0);
    }
    c.setLineDash([]);
    if (selected) {
      c.strokeStyle = colour(selected.category);
      c.globalAlpha = 0.35;
      c.lineWidth = 8 * px;
      line(selected.frames, NOW);
      c.globalAlpha = 1;
      c.lineWidth = 2.6 * px;
      c.setLineDash(selected.rejected_by ? [7 * px, 6 * px] : []);
      line(selected.frames, NOW);
      c.setLineDash([]);
      c.fillStyle = colour(selected.category);
      for (let f = NOW + 10; f < FRAMES; f += 10) {
        const s = selected.frames[f];
        if (!s) continue;
        c.beginPath();
        c.arc(s.x, s.y, 3 * px, 0, 7);
        c.fill();
      }
      if (show.certificate) {
        c.strokeStyle = colour("response");
        c.lineWidth = 2 * px;
        for (const response of selected.responses.values()) line(response.frames, NOW);
      }
    }
  }

  /** A box with its heading. A ghost is an outline; what is `strong` has a thick one. */
  agent(agent, state, px, { fill = null, ghost = false, strong = null, alpha = 1, label = null } = {}) {
    if (!state) return;
    const c = this.context, { camera } = this;
    // What is out of sight need not be drawn.
    const [sx, sy] = camera.toScreen(state.x, state.y);
    const reach = Math.hypot(agent.length, agent.width) * camera.scale;
    if (sx < -reach || sy < -reach || sx > camera.width + reach || sy > camera.height + reach) return;
    // People and cycles are kept large enough to be seen.
    const length = Math.max(agent.length, 5 * px), width = Math.max(agent.width, 4 * px);
    c.save();
    c.globalAlpha = alpha;
    c.translate(state.x, state.y);
    c.rotate(state.h);
    c.beginPath();
    c.roundRect(-length / 2, -width / 2, length, width, Math.min(length, width) * 0.18);
    if (!ghost) {
      c.fillStyle = fill ?? colour(agent.kind);
      c.fill();
    }
    c.lineWidth = (strong ? 2.2 : ghost ? 1.4 : 1) * px;
    c.strokeStyle = ghost ? colour("ghost") : strong ?? colour("outline");
    c.setLineDash(ghost ? [3 * px, 3 * px] : []);
    c.stroke();
    c.setLineDash([]);
    // The nose: where it is heading.
    c.beginPath();
    c.moveTo(length * 0.46, 0);
    c.lineTo(length * 0.2, width * 0.3);
    c.lineTo(length * 0.2, -width * 0.3);
    c.closePath();
    if (ghost) c.stroke();
    else {
      c.fillStyle = strong ?? colour("outline");
      c.globalAlpha *= 0.75;
      c.fill();
    }
    c.restore();
    const high = (Math.abs(Math.sin(state.h)) * length + Math.abs(Math.cos(state.h)) * width) / 2;
    if (label) this.labels.push([label, sx, sy - high * camera.scale - 4]);
  }

  label(text, x, y) {
    const c = this.context;
    c.save();
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.font = "600 11px system-ui, sans-serif";
    c.textAlign = "center";
    c.lineWidth = 3;
    c.strokeStyle = colour("panel");
    c.strokeText(text, x, y);
    c.fillStyle = colour("text");
    c.fillText(text, x, y);
    c.restore();
  }

  /** Where the AV is when somebody first touches it. */
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

  ruler() {
    const c = this.context, { camera } = this;
    const length = [5, 10, 20, 50, 100].find((m) => m * camera.scale >= 60) ?? 100;
    const x = camera.width - 14, y = camera.height - 14;
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.strokeStyle = colour("dim");
    c.fillStyle = colour("dim");
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(x - length * camera.scale, y - 4);
    c.lineTo(x - length * camera.scale, y);
    c.lineTo(x, y);
    c.lineTo(x, y - 4);
    c.stroke();
    c.font = "11px system-ui, sans-serif";
    c.textAlign = "right";
    c.fillText(`${length} m`, x, y - 7);
  }
}
