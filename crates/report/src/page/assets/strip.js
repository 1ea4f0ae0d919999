// Strips for case studies: frames at chosen times side by side, as one SVG.

import { Camera } from "./camera.js";
import { subjects } from "./data.js";
import { between } from "./geometry.js";
import { paint } from "./painter.js";
import { colour } from "./palette.js";
import { Vector } from "./vector.js";

const SIDE = 300, GAP = 10, HEAD = 26;

const escape = (text) => text.replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

/** Parses times in seconds up to `last`, such as `0, 2.5, 5`; null if invalid. */
export function times(text, last) {
  const out = text.split(/[,;\s]+/).filter(Boolean).map(Number);
  return out.length && out.length <= 12 && out.every((t) => t >= 0 && t <= last) ? out : null;
}

/**
 * The strip of a scene: a row per subject (by number), a column per time (seconds). The view is that of
 * `camera`, centred on the AV if `follow`.
 */
export function strip(scene, chosen, at, camera, follow, layers, replanOf) {
  const rows = chosen.filter((s) => scene.subjects.has(s));
  const width = GAP + at.length * (SIDE + GAP), height = rows.length * (HEAD + SIDE + GAP) + GAP;
  const out = [`<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" font-family="Helvetica, Arial, sans-serif">`, `<rect width="${width}" height="${height}" fill="${colour("panel")}"/>`];
  rows.forEach((number, r) => {
    const top = GAP + r * (HEAD + SIDE + GAP);
    out.push(`<text x="${GAP}" y="${top + 16}" font-size="14" font-weight="600" fill="${colour("text")}">${escape(`${scene.id} · ${subjects[number].name}`)}</text>`);
    const part = scene.subjects.get(number);
    at.forEach((t, k) => {
      const frame = scene.now + 10 * t;
      const own = Object.assign(new Camera(), { x: camera.x, y: camera.y, width: SIDE, height: SIDE, scale: (camera.scale * SIDE) / Math.min(camera.width, camera.height) });
      const av = between(part.tracks[0], frame);
      if (follow && av) [own.x, own.y] = [av.x, av.y];
      const c = new Vector();
      paint(c, scene, part, own, frame, layers, { replan: replanOf(number) });
      const x = GAP + k * (SIDE + GAP), y = top + HEAD;
      out.push(`<svg x="${x}" y="${y}" width="${SIDE}" height="${SIDE}" overflow="hidden">${c}</svg>`,
        `<rect x="${x}" y="${y}" width="${SIDE}" height="${SIDE}" fill="none" stroke="${colour("rule")}"/>`,
        `<text x="${x + 8}" y="${y + 18}" font-size="13" font-weight="600" fill="${colour("text")}" stroke="${colour("panel")}" stroke-width="3" paint-order="stroke">${t.toFixed(1)} s</text>`);
    });
  });
  out.push("</svg>");
  return out.join("\n");
}
