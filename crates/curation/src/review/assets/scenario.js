// Decoding of scenarios with their candidates.

import { FORM, FRAMES, NOW, agent, map } from "./decode.js";

/** Returns the 91 frames of a trajectory that begins at the current frame, after the frames of the log. */
function onFrames(track, before) {
  const out = new Array(FRAMES).fill(null);
  for (let f = 0; f < NOW; f++) out[f] = before?.[f] ?? null;
  for (let k = 0; k < track.x.length; k++) {
    out[NOW + k] = { x: track.x[k], y: track.y[k], h: track.h[k], v: track.v[k] ?? NaN };
  }
  return out;
}

/** Decodes a scenario from the server for drawing. */
export function decode(raw) {
  // A scene of another form would be drawn wrongly.
  const scene = raw.scene?.v === FORM ? raw.scene : null;
  const agents = scene ? scene.agents.map(agent) : [];
  // Without a scene there is still the AV.
  if (!agents.length) {
    const track = new Array(FRAMES).fill(null);
    agents.push({ id: "AV", kind: "vehicle", length: 4.8, width: 2, track });
  }
  const places = new Map(agents.map((a, i) => [a.id, i]));
  const candidates = raw.candidates.map((c) => ({
    ...c,
    frames: onFrames(c.track, agents[0].track),
    responses: new Map((c.certificate ?? []).filter((r) => places.has(r.agent)).map((r) => {
      const at = places.get(r.agent);
      return [at, { ...r, frames: onFrames(r.track, agents[at].track) }];
    })),
    // Computed when first selected.
    analysis: null,
    certified: null,
  }));
  // Best first; rejected candidates after survivors.
  const score = (c) => c.score ?? -1e9;
  candidates.sort((a, b) => !!a.rejected_by - !!b.rejected_by || score(b) - score(a) || a.number - b.number);
  return {
    index: raw.index,
    id: raw.id,
    stale: raw.stale,
    /** Reason why there is no scene; null if there is one. */
    bare: scene ? null : raw.scene
      ? `the scene has form ${raw.scene.v ?? "?"}, this page draws form ${FORM}: only the AV is drawn; ` +
        "make the file again, or review it with the program version that made it"
      : "this file holds no scenes (--without-scenes): only the AV is drawn",
    candidates,
    agents,
    context: scene ? scene.context.map(agent) : [],
    map: scene ? map(scene) : null,
  };
}
