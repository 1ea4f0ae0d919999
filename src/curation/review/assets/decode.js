// From what the server sends to what is drawn. Lengths come as centimetres, angles as milliradians; here all is metres and radians.

export const FRAMES = 91;
/** The form of scenes that is understood here. */
const FORM = 1;
/** The frame that is now: step 0. */
export const NOW = 10;
export const KINDS = ["vehicle", "pedestrian", "cyclist", "other"];
export const CATEGORIES = ["longitudinal", "lateral", "directional"];

/** Flat centimetres, the first point whole and the others as differences, to flat metres. */
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

/** A line as a path to draw, in metres. */
function path(lines, closed = false) {
  const path = new Path2D();
  for (const points of lines) {
    for (let i = 0; i + 1 < points.length; i += 2) path[i ? "lineTo" : "moveTo"](points[i], points[i + 1]);
    if (closed) path.closePath();
  }
  return path;
}

function agent(raw) {
  const track = new Array(FRAMES).fill(null);
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

/** The lines of one kind together, as [kind, path]. */
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

function map(raw) {
  const lanes = new Map();
  const centers = [];
  for (const [kind, half, points] of raw.lanes) {
    const line = metres(points);
    centers.push(line);
    if (!half) continue;
    // Lanes of bicycles are recorded with the width of a car's.
    const bike = kind === 3;
    const key = `${bike ? 1 : 0} ${half}`;
    if (!lanes.has(key)) lanes.set(key, { bike, width: (2 * half * (bike ? 0.5 : 1)) / 100, lines: [] });
    lanes.get(key).lines.push(line);
  }
  const corridors = [...lanes.values()].map((lane) => ({ bike: lane.bike, width: lane.width, path: path(lane.lines) }));
  corridors.sort((a, b) => a.bike - b.bike);
  const drivable = new Path2D();
  for (const polygon of raw.drivable) drivable.addPath(outlines(polygon));
  return {
    hasArea: raw.drivable.length > 0,
    drivable,
    corridors,
    centers: path(centers),
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

/** 91 frames of a trajectory that begins at the current frame; the log of the AV comes before it. */
function onFrames(track, before) {
  const out = new Array(FRAMES).fill(null);
  for (let f = 0; f < NOW; f++) out[f] = before?.[f] ?? null;
  for (let k = 0; k < track.x.length; k++) {
    out[NOW + k] = { x: track.x[k], y: track.y[k], h: track.h[k], v: track.v[k] ?? NaN };
  }
  return out;
}

/** A scenario as the server sends it, ready to be drawn. */
export function decode(raw) {
  // Another form would be drawn, and be wrong.
  const scene = raw.scene?.v === FORM ? raw.scene : null;
  const agents = scene ? scene.agents.map(agent) : [];
  // Without a scene there is still the AV.
  if (!agents.length) agents.push({ id: "AV", kind: "vehicle", length: 4.8, width: 2, track: new Array(FRAMES).fill(null) });
  const places = new Map(agents.map((a, i) => [a.id, i]));
  const candidates = raw.candidates.map((c) => ({
    ...c,
    frames: onFrames(c.track, agents[0].track),
    responses: new Map((c.certificate ?? []).filter((r) => places.has(r.agent)).map((r) => {
      const at = places.get(r.agent);
      return [at, { ...r, frames: onFrames(r.track, agents[at].track) }];
    })),
    // Analysed when it is first looked at.
    analysis: null,
    certified: null,
  }));
  // The best first; what was rejected comes after what survived.
  const worth = (c) => c.score ?? -1e9;
  candidates.sort((a, b) => !!a.rejected_by - !!b.rejected_by || worth(b) - worth(a) || a.number - b.number);
  return {
    index: raw.index,
    id: raw.id,
    stale: raw.stale,
    /** Why there is no scene; null where there is one. */
    bare: scene ? null : raw.scene
      ? `the scene has form ${raw.scene.v ?? "?"}, this page draws form ${FORM}: only the AV is drawn; make the file anew, or review it with the program that made it`
      : "this file holds no scenes (--without-scenes): only the AV is drawn",
    candidates,
    agents,
    context: scene ? scene.context.map(agent) : [],
    map: scene ? map(scene) : null,
  };
}
