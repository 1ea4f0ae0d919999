// Box distances and times to collision as defined by the metrics (ReactSim-Bench, "Metric Computation
// Details"), so that pages highlight what the metrics count.

/** Corner rounding of the benchmark, as a fraction of the smaller half side. */
const ROUNDING = 0.7;
/** Time to collision without approach, seconds. */
export const NO_RISK = 5;
/** Time to collision below which an approach is risky, seconds. */
export const RISKY = 0.5;

const box = (s, agent) => ({
  x: s.x, y: s.y, c: Math.cos(s.h), s: Math.sin(s.h), l: agent.length / 2, w: agent.width / 2,
});

/** Distance from a point to a box. */
function toPoint(b, px, py) {
  const dx = px - b.x, dy = py - b.y;
  const x = Math.max(0, Math.abs(dx * b.c + dy * b.s) - b.l);
  const y = Math.max(0, Math.abs(dy * b.c - dx * b.s) - b.w);
  return Math.hypot(x, y);
}

function* corners(b) {
  for (const [i, j] of [[1, 1], [1, -1], [-1, -1], [-1, 1]]) {
    yield [b.x + i * b.l * b.c - j * b.w * b.s, b.y + i * b.l * b.s + j * b.w * b.c];
  }
}

/** Signed distance of two boxes with rounded corners, metres; negative if they overlap. */
export function distance(first, second) {
  const round = (b) => ROUNDING * Math.min(b.l, b.w);
  const [ra, rb] = [round(first), round(second)];
  const a = { ...first, l: first.l - ra, w: first.w - ra };
  const b = { ...second, l: second.l - rb, w: second.w - rb };
  const dx = b.x - a.x, dy = b.y - a.y;
  const cos = Math.abs(a.c * b.c + a.s * b.s), sin = Math.abs(a.c * b.s - a.s * b.c);
  const separation = Math.max(
    Math.abs(dx * a.c + dy * a.s) - a.l - (b.l * cos + b.w * sin),
    Math.abs(dy * a.c - dx * a.s) - a.w - (b.l * sin + b.w * cos),
    Math.abs(dx * b.c + dy * b.s) - b.l - (a.l * cos + a.w * sin),
    Math.abs(dy * b.c - dx * b.s) - b.w - (a.l * sin + a.w * cos),
  );
  let best = separation;
  if (separation > 0) {
    best = Infinity;
    for (const [x, y] of corners(b)) best = Math.min(best, toPoint(a, x, y));
    for (const [x, y] of corners(a)) best = Math.min(best, toPoint(b, x, y));
  }
  return best - ra - rb;
}

/** Seconds until a vehicle runs into the AV that it follows; NO_RISK if it does not. */
function timeToCollision(me, mine, speed, av, avSpeed) {
  const closing = speed - avSpeed;
  if (!(closing > 0)) return NO_RISK;
  const dx = av.x - me.x, dy = av.y - me.y;
  const ahead = dx * me.c + dy * me.s, aside = me.c * dy - me.s * dx;
  const cos = Math.abs(me.c * av.c + me.s * av.s), sin = Math.abs(me.c * av.s - me.s * av.c);
  const gap = ahead - mine.length / 2 - (av.l * cos + av.w * sin);
  const beside = Math.abs(aside) - mine.width / 2 - (av.l * sin + av.w * cos);
  if (!(gap > 0 && beside < 0)) return NO_RISK;
  const turned = Math.abs(Math.atan2(me.c * av.s - me.s * av.c, me.c * av.c + me.s * av.s)) * (180 / Math.PI);
  const isFront = turned <= 75 && (beside < -0.5 || turned <= 10);
  return isFront ? Math.min(gap / closing, NO_RISK) : NO_RISK;
}

/** Seconds until an agent runs into the AV that it follows; NO_RISK if it does not. */
export function approach(agent, state, av, avState) {
  return timeToCollision(box(state, agent), agent, state.v, box(avState, av), avState.v);
}

/**
 * Analyses the AV on `frames` and the agents with tracks `trackOf(i)`: per frame the smallest time to
 * collision of a vehicle, the distance to the nearest agent, the agents that touch the AV and those at
 * risk. Frames before the current one, `now`, are left out.
 */
export function analyse(agents, frames, trackOf, now) {
  const fill = (value) => new Array(frames.length).fill(value);
  const out = { ttc: fill(null), gap: fill(null), touching: fill(null), risky: fill(null), first: new Map() };
  for (let f = now; f < frames.length; f++) {
    const state = frames[f];
    if (!state) continue;
    const av = box(state, agents[0]);
    const reach = Math.hypot(av.l, av.w);
    let ttc = NO_RISK, gap = Infinity;
    const touching = new Set(), risky = new Set();
    for (let i = 1; i < agents.length; i++) {
      const s = trackOf(i)[f];
      if (!s) continue;
      const b = box(s, agents[i]);
      // Distant agents need no exact distance.
      if (Math.hypot(b.x - av.x, b.y - av.y) - reach - Math.hypot(b.l, b.w) < Math.max(gap, 0)) {
        const d = distance(av, b);
        gap = Math.min(gap, d);
        if (d < 0) {
          touching.add(i);
          if (!out.first.has(i)) out.first.set(i, f);
        }
      }
      if (agents[i].kind !== "vehicle") continue;
      const t = touching.has(i) ? 0 : timeToCollision(b, agents[i], s.v, av, state.v);
      ttc = Math.min(ttc, t);
      // The metrics start at step 1.
      if (t < RISKY && f > now) risky.add(i);
    }
    // Without other agents there is no value.
    out.ttc[f] = agents.length > 1 ? ttc : null;
    out.gap[f] = Number.isFinite(gap) ? Math.max(gap, 0) : null;
    [out.touching[f], out.risky[f]] = [touching, risky];
  }
  return out;
}

/** Interpolates the state between two frames. */
export function between(frames, t) {
  const f = Math.min(Math.floor(t), frames.length - 1), u = t - f;
  const a = frames[f], b = frames[Math.min(f + 1, frames.length - 1)];
  if (!a || !b || u === 0) return a;
  const turn = Math.atan2(Math.sin(b.h - a.h), Math.cos(b.h - a.h));
  const mix = (p, q) => p + (q - p) * u;
  return { x: mix(a.x, b.x), y: mix(a.y, b.y), h: a.h + turn * u, v: mix(a.v, b.v) };
}
