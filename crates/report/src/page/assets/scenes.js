// Scenes: loading and decoding.

import { data, ownMetrics, scenarios } from "./data.js";
import { agent, axis, map, realised, unpack } from "./decode.js";
import { analyse } from "./geometry.js";

/** Supported version of the scene format. */
const FORM = 1;
/** Maximum number of cached scenes. */
const MAX_CACHED = 12;

const cache = new Map();

/** Returns whether a scenario has a scene. */
export const drawable = (index) => scenarios.scene[index] === 1;

/** Loads the scene of a scenario from the page, or from the program that serves it. */
export function load(index) {
  if (!cache.has(index)) {
    const promise = raw(index).then(decode);
    promise.catch(() => cache.delete(index));
    cache.set(index, promise);
    if (cache.size > MAX_CACHED) cache.delete(cache.keys().next().value);
  }
  return cache.get(index);
}

async function raw(index) {
  if (data.live) {
    const response = await fetch(`scene/${index}`);
    if (!response.ok) throw new Error((await response.text()).trim() || `the server answered ${response.status}`);
    return response.json();
  }
  return unpack(`scene-${index}`);
}

/** Kinds of states, the most severe first. */
export const STATES = ["fault", "contact", "risky", "offroad", "against", "red", "own"];

/** States of the agents: `states[agent][frame]` is one of STATES or undefined. */
function states(agents, events, analysis, frames) {
  const out = agents.map(() => new Array(frames));
  const put = (i, from, to, kind) => {
    for (let f = from; f <= Math.min(to, frames - 1); f++) {
      const old = out[i][f];
      if (!old || STATES.indexOf(kind) < STATES.indexOf(old)) out[i][f] = kind;
    }
  };
  for (const e of events) {
    if (e.metric === "aav-collision") {
      // A contact lasts as long as the boxes touch.
      let to = e.to;
      while (to + 1 < frames && analysis.touching[to + 1]?.has(e.agent)) to++;
      put(e.agent, e.from, to, e.counted ? "fault" : "contact");
    } else if (e.metric === "aa-collision") {
      put(e.agent, e.from, e.to, "contact");
      if (e.partner !== undefined) put(e.partner, e.from, e.to, "contact");
    } else if (e.metric === "aav-ttc") put(e.agent, e.from, Math.max(e.to, e.from + 2), "risky");
    else if (e.metric === "offroad") put(e.agent, e.from, e.to, "offroad");
    else if (e.metric === "direction") put(e.agent, e.from, e.to, "against");
    else if (e.metric === "red-light") put(e.agent, e.from, Math.max(e.to, e.from + 9), "red");
    else if (ownMetrics.includes(e.metric)) put(e.agent, e.from, e.to, "own");
  }
  return out;
}

function decode(raw) {
  if (raw.v !== FORM) throw new Error(`the scene has format version ${raw.v}, this page supports ${FORM}: create the page again`);
  const { now, frames } = axis(raw.sketch);
  const agents = raw.sketch.agents.map((a) => agent(a, frames));
  const subjects = new Map(raw.subjects.map((s) => {
    const tracks = s.tracks.map((spans, i) => realised(spans, agents[i].track, now));
    const events = s.events.map((e) => ({ ...e, from: now + e.step, to: now + e.last })).sort((a, b) => a.from - b.from);
    const analysis = analyse(agents, tracks[0], (i) => tracks[i], now);
    return [s.subject, { tracks, events, analysis, states: states(agents, events, analysis, frames) }];
  }));
  return { id: raw.id, source: raw.source, now, frames, agents, context: raw.sketch.context.map((a) => agent(a, frames)), map: map(raw.sketch), subjects };
}
