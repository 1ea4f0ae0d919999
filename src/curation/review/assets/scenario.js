// A scenario with its candidates, as the server sends it.

import { FORM, FRAMES, NOW, agent, map } from "./decode.js";

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
