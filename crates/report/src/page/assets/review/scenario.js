// Loading and decoding of a scenario with its candidates.

import { FORM, USUAL, agent, axis, map, realised, unpack } from "./decode.js";
import { data } from "./decisions.js";
import { analyse } from "./geometry.js";

/** Maximum number of decoded scenarios, shown and prefetched. */
const MAX_CACHED = 8;
const cache = new Map();

/** Returns a scenario of the page. */
export function load(index) {
  if (!cache.has(index)) {
    cache.set(index, unpack(`scene-${index}`).then((raw) => decode(index, raw)));
    // Evict the oldest.
    if (cache.size > MAX_CACHED) cache.delete(cache.keys().next().value);
  }
  return cache.get(index);
}

function decode(index, raw) {
  // A scene of another form would be drawn wrongly.
  const scene = raw.sketch?.v === FORM ? raw.sketch : null;
  // Without a scene, candidates still have all steps: three numbers each.
  const steps = Math.max(...raw.candidates.flatMap((c) => c.track.map((span) => span[0] - 1 + (span.length - 1) / 3)), 0);
  const { now, frames } = scene ? axis(scene) : { now: USUAL.now, frames: USUAL.now + 1 + steps };
  const agents = scene ? scene.agents.map((a) => agent(a, frames)) : [];
  // Without a scene there is still the AV.
  if (!agents.length) {
    agents.push({ id: "AV", kind: "vehicle", length: 4.8, width: 2, track: new Array(frames).fill(null) });
  }
  const places = new Map(agents.map((a, i) => [a.id, i]));
  const candidates = raw.candidates.map((c) => ({
    ...c,
    frames: realised(c.track, agents[0].track, now),
    responses: new Map((c.certificate ?? []).filter((r) => places.has(r.agent)).map((r) => {
      const at = places.get(r.agent);
      return [at, { ...r, frames: realised(r.track, agents[at].track, now) }];
    })),
    // Computed when first selected.
    analysis: null,
    certified: null,
  }));
  // Best first; rejected candidates after survivors.
  const score = (c) => c.score ?? -1e9;
  candidates.sort((a, b) => !!a.rejected_by - !!b.rejected_by || score(b) - score(a) || a.number - b.number);
  return {
    index,
    now,
    frames,
    ...data.scenarios[index],
    /** Reason why there is no scene; null if there is one. */
    bare: scene ? null : raw.sketch
      ? `the scene has form ${raw.sketch.v ?? "?"}, this page draws form ${FORM}: only the AV is drawn; ` +
        "make the file again, or review it with the program version that made it"
      : "this file holds no scenes (--without-scenes): only the AV is drawn",
    candidates,
    agents,
    /** Interactions with the logged AV. */
    logged: analyse(agents, agents[0].track, (i) => agents[i].track, now),
    context: scene ? scene.context.map((a) => agent(a, frames)) : [],
    map: scene ? map(scene) : null,
  };
}
