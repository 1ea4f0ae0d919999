// Decoding of sketches of scenarios: centimetres and milliradians to metres and radians.

/** Supported version of the sketch format. */
export const FORM = 1;
/** The current frame (step 0) and the number of frames of scenarios whose sketch states no others. */
export const USUAL = { now: 10, frames: 91 };
export const KINDS = ["vehicle", "pedestrian", "cyclist", "other"];
export const CATEGORIES = ["longitudinal", "lateral", "directional"];

/** Converts flat centimetres (first point, then differences) to flat metres. */
function metres(flat) {
  const out = new Float64Array(flat.length);
  let x = 0, y = 0;
  for (let i = 0; i + 1 < flat.length; i += 2) {
    x += flat[i];
    y += flat[i + 1];
    out[i] = x / 100;
    out[i + 1] = y / 100;
  }
  return out;
}

/** Lines as a path in metres; `d` holds its SVG path data. */
function path(lines, closed = false) {
  let d = "";
  for (const points of lines) {
    for (let i = 0; i + 1 < points.length; i += 2) d += `${i ? "L" : "M"}${points[i]} ${points[i + 1]}`;
    if (closed && points.length) d += "Z";
  }
  const path = new Path2D(d);
  path.d = d;
  return path;
}

/** The current frame and the number of frames of a sketch. */
export function axis(raw) {
  const [now, frames] = raw.length ?? [USUAL.now, USUAL.frames];
  return { now, frames };
}

/** Frames between two labels of a time axis: whole seconds, so that labels do not overlap. */
export const spacing = (frames) => [10, 50, 100, 500].find((n) => frames / n <= 20) ?? 1000;

/** An agent with its logged track of `frames` frames. */
export function agent(raw, frames) {
  const track = new Array(frames).fill(null);
  for (const span of raw.t) {
    let x = 0, y = 0, h = 0, v = 0;
    for (let i = 1, f = span[0]; i + 3 < span.length; i += 4, f++) {
      x += span[i];
      y += span[i + 1];
      h += span[i + 2];
      v += span[i + 3];
      track[f] = { x: x / 100, y: y / 100, h: h / 1000, v: v / 100 };
    }
  }
  return { id: raw.id, kind: KINDS[raw.k] ?? "other", length: raw.l / 100, width: raw.w / 100, track };
}

/** Groups lines by kind: a list of [kind, path]. */
function byKind(raw) {
  const groups = new Map();
  for (const [kind, points] of raw) {
    if (!groups.has(kind)) groups.set(kind, []);
    groups.get(kind).push(metres(points));
  }
  return [...groups].map(([kind, lines]) => [kind, path(lines)]);
}

const outlines = (raw) => path(raw.map(metres), true);

/** Stripes along a crosswalk, clipped when drawn. */
function stripes(raw) {
  return raw.map((flat) => {
    const p = metres(flat);
    let n = p.length / 2;
    if (n > 1 && p[0] === p[2 * n - 2] && p[1] === p[2 * n - 1]) n--;
    let along = [1, 0], longest = 0, cx = 0, cy = 0;
    for (let i = 0; i < n; i++) {
      const j = (i + 1) % n;
      const d = [p[2 * j] - p[2 * i], p[2 * j + 1] - p[2 * i + 1]];
      const length = Math.hypot(...d);
      if (length > longest) [longest, along] = [length, [d[0] / length, d[1] / length]];
      cx += p[2 * i] / n;
      cy += p[2 * i + 1] / n;
    }
    const lines = [];
    const reach = Math.min(longest, 60);
    for (let s = -reach; s <= reach; s += 1.2) {
      const [x, y] = [cx + along[0] * s, cy + along[1] * s];
      lines.push([x - along[1] * 20, y + along[0] * 20, x + along[1] * 20, y - along[0] * 20]);
    }
    return { area: path([p], true), stripes: path(lines) };
  });
}

/** Distance between two arrows along a centre line, metres. */
const STRETCH = 20;

function arrows(lines) {
  const out = [];
  for (const p of lines) {
    let next = STRETCH / 2, done = 0;
    for (let i = 2; i + 1 < p.length; i += 2) {
      const [dx, dy] = [p[i] - p[i - 2], p[i + 1] - p[i - 1]];
      const length = Math.hypot(dx, dy);
      for (; length > 0 && next <= done + length; next += STRETCH) {
        const [u, v, s] = [dx / length, dy / length, next - done];
        const [x, y] = [p[i - 2] + u * s, p[i - 1] + v * s];
        const back = (side) => [x - 1.3 * u - side * 0.8 * v, y - 1.3 * v + side * 0.8 * u];
        out.push([...back(1), x, y, ...back(-1)].map((c) => Math.round(c * 100) / 100));
      }
      done += length;
    }
  }
  return out;
}

/** Decodes the map. */
export function map(raw) {
  const lanes = new Map();
  const centers = [];
  for (const [kind, half, points] of raw.lanes) {
    const line = metres(points);
    centers.push(line);
    if (!half) continue;
    // Bicycle lanes are recorded with the width of car lanes.
    const bike = kind === 3;
    const key = `${bike ? 1 : 0} ${half}`;
    if (!lanes.has(key)) lanes.set(key, { bike, width: (2 * half * (bike ? 0.5 : 1)) / 100, lines: [] });
    lanes.get(key).lines.push(line);
  }
  const corridors = [...lanes.values()].map((lane) => ({ bike: lane.bike, width: lane.width, path: path(lane.lines) }));
  corridors.sort((a, b) => a.bike - b.bike);
  const drivable = outlines(raw.drivable.flat());
  return {
    hasArea: raw.drivable.length > 0,
    drivable,
    corridors,
    centers: path(centers),
    arrows: path(arrows(centers)),
    laneAreas: outlines(raw.lane_areas),
    junctions: outlines(raw.junctions),
    driveways: outlines(raw.driveways),
    bumps: outlines(raw.bumps),
    crosswalks: stripes(raw.crosswalks),
    edges: path(raw.edges.map(([, points]) => metres(points))),
    paint: byKind(raw.paint),
    stops: byKind(raw.stops),
    lights: raw.lights.map(([x, y, states]) => ({ x: x / 100, y: y / 100, states })),
  };
}

/**
 * Decodes a track: the log up to the current frame `now`, then the spans of src/page/tracks.rs.
 * Velocities are differences of positions.
 */
export function realised(spans, logged, now) {
  const track = new Array(logged.length).fill(null);
  for (let f = 0; f <= now; f++) track[f] = logged[f];
  for (const span of spans) {
    const at = [0, 0, 0], by = [0, 0, 0];
    for (let i = 1, f = now + span[0]; i + 2 < span.length; i += 3, f++) {
      for (let k = 0; k < 3; k++) {
        if (i === 1) at[k] = span[i + k];
        else at[k] += by[k] += span[i + k];
      }
      track[f] = { x: at[0] / 1000, y: at[1] / 1000, h: at[2] / 1000, v: NaN };
    }
  }
  for (let f = now + 1; f < track.length; f++) {
    const [a, b] = [track[f - 1], track[f]];
    if (a && b) b.v = Math.hypot(b.x - a.x, b.y - a.y) / 0.1;
  }
  return track;
}

/** JSON of an element of this id, compressed with gzip and encoded in Base64. */
export async function unpack(id) {
  const packed = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
}
