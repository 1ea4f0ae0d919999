// Agents of a scene from above. World coordinates are metres with y up; line widths are pixels.

import { colour } from "./palette.js";

/** Colours by the code of a light (0 to 8, `-` if not observed). */
const LIGHTS = { 1: "light-stop", 4: "light-stop", 7: "light-stop", 2: "light-caution", 5: "light-caution", 8: "light-caution", 3: "light-go", 6: "light-go" };

/** Draws the lights of a map at a frame; a pixel is `px` metres. */
export function lights(c, map, f, px) {
  for (const light of map?.lights ?? []) {
    c.beginPath();
    c.arc(light.x, light.y, Math.max(0.75, 3 * px), 0, 7);
    c.fillStyle = colour(LIGHTS[light.states[f]] ?? "light-unknown");
    c.fill();
    c.lineWidth = px;
    c.strokeStyle = colour("ground");
    c.stroke();
  }
}

/**
 * Draws an agent as a box with its heading; a ghost is an outline. If `label` is given, adds
 * `[text, x, y]` in pixels to `labels`, which are drawn on top of all boxes.
 */
export function box(c, camera, agent, state, px, { fill = null, line = null, width = 1, dash = [], ghost = false, alpha = 1, ring = null, label = null, below = false } = {}, labels = []) {
  if (!state) return;
  // Skip agents out of view.
  const [sx, sy] = camera.toScreen(state.x, state.y);
  const reach = Math.hypot(agent.length, agent.width) * camera.scale;
  if (sx < -reach || sy < -reach || sx > camera.width + reach || sy > camera.height + reach) return;
  // Small agents are enlarged to stay visible.
  const long = Math.max(agent.length, 5 * px), wide = Math.max(agent.width, 4 * px);
  const ink = ghost ? colour("ghost") : line ?? colour("outline");
  c.save();
  c.globalAlpha = alpha;
  c.translate(state.x, state.y);
  c.rotate(state.h);
  c.beginPath();
  c.roundRect(-long / 2, -wide / 2, long, wide, Math.min(long, wide) * 0.18);
  if (!ghost) {
    c.fillStyle = fill ?? colour(agent.kind);
    c.fill();
  }
  c.lineWidth = (ghost ? 1.4 : width) * px;
  c.strokeStyle = ink;
  c.setLineDash((ghost ? [3, 3] : dash).map((d) => d * px));
  c.stroke();
  c.setLineDash([]);
  // A wedge in the direction of the heading.
  c.beginPath();
  c.moveTo(long * 0.46, 0);
  c.lineTo(long * 0.2, wide * 0.3);
  c.lineTo(long * 0.2, -wide * 0.3);
  c.closePath();
  if (ghost) c.stroke();
  else {
    c.fillStyle = ink;
    c.globalAlpha = 0.75 * alpha;
    c.fill();
  }
  if (ring) {
    c.globalAlpha = alpha;
    c.strokeStyle = ring;
    c.lineWidth = 2 * px;
    c.beginPath();
    c.arc(0, 0, Math.max(0.62 * Math.hypot(long, wide), 9 * px), 0, 7);
    c.stroke();
  }
  c.restore();
  const high = (camera.scale * (Math.abs(Math.sin(state.h)) * long + Math.abs(Math.cos(state.h)) * wide)) / 2;
  if (label) labels.push([label, sx, below ? sy + high + 13 : sy - high - 4]);
}

/** Draws labels at pixel positions. */
export function names(c, labels) {
  c.font = "600 11px system-ui, sans-serif";
  c.textAlign = "center";
  c.lineWidth = 3;
  for (const [text, x, y] of labels) {
    c.strokeStyle = colour("panel");
    c.strokeText(text, x, y);
    c.fillStyle = colour("text");
    c.fillText(text, x, y);
  }
}

/** Draws a scale bar of a round length. */
export function ruler(c, camera) {
  const length = [5, 10, 20, 50, 100].find((m) => m * camera.scale >= 60) ?? 100;
  const x = camera.width - 14, y = camera.height - 14;
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
