// The map from above, cached as a picture: drawing all lanes for every frame would be slow.

import { colour } from "./palette.js";

/** Codes of painted lines: broken (otherwise solid), yellow (otherwise white), double. */
const BROKEN = new Set([1, 4, 5]);
const YELLOW = new Set([4, 5, 6, 7, 8]);
const DOUBLE = new Set([3, 7, 8]);
/** Half width of the pale margin around centre lines of maps without drivable area, metres. */
const SHOULDER = 2.9;
/** Size of the cached picture relative to the view: above 1, so that small camera moves need no redraw. */
const SPARE = 1.6;

/** Cached picture of the road. */
export class Road {
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

/** Paints the map in metres; `scale` is pixels per metre. */
export function paintMap(c, map, scale) {
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
