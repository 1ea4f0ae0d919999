// Information next to the views: timeline, current values, events, and the agent under the pointer.

import { sharp } from "./curves.js";
import { avMetrics, data, metric, ownMetrics, value } from "./data.js";
import { spacing } from "./decode.js";
import { el } from "./dom.js";
import { number, seconds, titled } from "./format.js";
import { NO_RISK, RISKY, approach } from "./geometry.js";
import { LOOKS } from "./painter.js";
import { colour } from "./palette.js";

const EVENTS = { "aav-collision": "fault", "aa-collision": "contact", "aav-ttc": "risky", offroad: "offroad", direction: "against", "red-light": "red" };

/** The style of an event; undefined if it has no mark. */
export const eventKind = (e) => (e.metric === "aav-collision" && !e.counted ? "contact" : metric(e.metric)?.av ? "av" : metric(e.metric)?.own ? "own" : EVENTS[e.metric]);

/** The timeline of a scene: a row for every simulator with its events. */
export function timeline(canvas, { now, frames }, parts, t) {
  const { c, width } = sharp(canvas);
  if (!width) return;
  const x = (f) => 8 + (f / (frames - 1)) * (width - 16);
  parts.forEach((part, i) => {
    const y = 12 + 16 * i;
    c.fillStyle = colour("rule");
    c.fillRect(x(0), y - 2, x(frames - 1) - x(0), 4);
    c.fillStyle = colour("center");
    c.fillRect(x(0), y - 2, x(now) - x(0), 4);
    for (const e of part?.events ?? []) {
      const kind = eventKind(e);
      if (!kind) continue;
      c.fillStyle = colour(LOOKS[kind].fill);
      c.strokeStyle = colour("text");
      c.lineWidth = kind === "fault" ? 1.6 : 0.8;
      c.globalAlpha = 0.55;
      c.fillRect(x(e.from), y - 2, Math.max(2, x(e.to) - x(e.from)), 4);
      c.globalAlpha = 1;
      c.beginPath();
      if (kind === "fault") c.arc(x(e.from), y, 5, 0, 7);
      else if (kind === "risky") c.moveTo(x(e.from) - 4, y + 4), c.lineTo(x(e.from), y - 5), c.lineTo(x(e.from) + 4, y + 4), c.closePath();
      else if (kind === "contact") c.rect(x(e.from) - 3.5, y - 3.5, 7, 7);
      else c.rect(x(e.from) - 1.5, y - 4, 3, 8);
      c.fill();
      c.stroke();
    }
  });
  c.font = "10px system-ui, sans-serif";
  c.textAlign = "center";
  const every = spacing(frames);
  for (let f = now % every; f < frames; f += every) {
    c.fillStyle = colour("dim");
    c.fillText(`${(f - now) / 10}`, x(f), 46);
  }
  c.fillStyle = colour("text");
  c.fillRect(x(t) - 1, 2, 2, 34);
}

/** Table of current values and values of the whole rollout, for these simulators (null for none). */
export function facts(table, simulators, index) {
  const judged = avMetrics.filter((id) => simulators.some((subject) => subject !== null && value(subject, id, index) !== null));
  const shown = [...judged, "aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "acceleration", "curvature", "red-light", "ade", ...ownMetrics].filter((id) => metric(id));
  const row = (id, title) => el("tr", {}, el("th", { scope: "row" }, title), ...simulators.flatMap((subject, i) => (subject === null ? [] : [
    el("td", { class: "number", "data-pane": i, "data-now": id }),
    el("td", { class: "number dim", "data-pane": i, "data-whole": id }, metric(id) ? number(metric(id), value(subject, id, index)) : ""),
  ])));
  table.replaceChildren(
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Measure"), ...simulators.flatMap((subject, i) => (subject === null ? [] : [el("th", { scope: "col", class: "number" }, `${i ? "right" : "left"} now`), el("th", { scope: "col", class: "number" }, "all")])))),
    el("tbody", {}, ...shown.map((id) => row(id, metric(id).own ? titled(metric(id)) : `${metric(id).title}${metric(id).unit === "rate" ? " (all: %)" : ""}`)), row("gap", "Nearest agent")));
}

/** Fills in the values at this frame. */
export function now(table, scene, parts, f) {
  const covering = (part, id) => part.events.filter((e) => e.metric === id && e.from <= f && f <= e.to).length;
  parts.forEach((part, i) => {
    for (const cell of table.querySelectorAll(`[data-pane="${i}"][data-now]`)) {
      const id = cell.dataset.now;
      const ttc = part?.analysis.ttc[f], gap = part?.analysis.gap[f];
      cell.textContent = !part || f < scene.now ? "–"
        : id === "aav-collision" ? String(part.analysis.touching[f]?.size ?? 0)
        : id === "aav-ttc" ? (ttc === null || ttc === undefined ? "–" : `${ttc >= NO_RISK ? "≥ " : ""}${ttc.toFixed(2)} s`)
        : metric(id)?.av ? String(covering(part, id) || "")
        : id === "gap" ? (gap === null || gap === undefined ? "–" : `${gap.toFixed(1)} m`)
        : id === "ade" ? `${displacement(scene, part, f)} m`
        : String(covering(part, id));
      cell.classList.toggle("bad", (id === "aav-ttc" && ttc < RISKY) || (!["aav-ttc", "gap", "ade"].includes(id) && Number(cell.textContent) > 0));
    }
  });
}

/** Mean displacement of the agents from the log at a frame, metres. */
function displacement(scene, part, f) {
  let [sum, n] = [0, 0];
  for (let i = 1; i < scene.agents.length; i++) {
    const [a, b] = [part.tracks[i][f], scene.agents[i].track[f]];
    if (a && b) [sum, n] = [sum + Math.hypot(a.x - b.x, a.y - b.y), n + 1];
  }
  return n ? (sum / n).toFixed(2) : "–";
}

/** The list of events; `pick` is called with the chosen one. */
export function events(list, scene, parts, several, pick) {
  const all = parts.flatMap((part, i) => (part?.events ?? []).filter((e) => eventKind(e)).map((e) => ({ ...e, pane: i })));
  all.sort((a, b) => a.from - b.from || a.pane - b.pane);
  const words = (e) => {
    const who = scene.agents[e.agent].id, partner = e.partner === undefined ? "" : ` with ${e.partner === 0 ? "the AV" : scene.agents[e.partner].id}`;
    const unit = (name) => data.event_units[name] && ` ${data.event_units[name]}`;
    const values = (e.values ?? []).map(([k, v]) => `${k.replaceAll("_", " ")} ${v}${unit(k) || ""}`).join(", ");
    return `${who}${partner}${e.reason ? `, ${e.reason.replaceAll("_", " ")}` : ""}${values ? ` (${values})` : ""}`;
  };
  list.replaceChildren(...(all.length ? all.slice(0, 200).map((e) => {
    const kind = eventKind(e);
    return el("li", {}, el("button", { class: "event", "data-from": e.from, onclick: () => pick(e) }, el("i", { class: `dot ${kind}`, "aria-hidden": "true" }), el("b", {}, seconds(e.from, scene.now)), ` ${!several ? "" : e.pane ? "right: " : "left: "}${kind === "own" ? metric(e.metric).title : kind === "av" ? `${metric(e.metric).title} violated` : LOOKS[kind].name}: ${words(e)}`));
  }) : [el("li", { class: "dim" }, "No events.")]));
}

/** Tooltip of an agent at a frame. */
export function agent(tip, scene, part, i, t) {
  const [about, track] = [scene.agents[i], part.tracks[i]];
  const s = track[t], av = part.tracks[0][t];
  const [a, b] = [track[t - 1], track[t + 1]];
  const acceleration = a && b ? ((b.v - a.v) / 0.2).toFixed(1) : "–";
  const ttc = i > 0 && s && av && about.kind === "vehicle" ? approach(about, s, scene.agents[0], av) : null;
  const logged = scene.agents[i].track[t];
  const fact = (name, text) => el("div", {}, el("span", { class: "dim" }, `${name} `), text);
  tip.replaceChildren(...[
    el("b", {}, i === 0 ? `AV (${about.id})` : about.id),
    fact("class", `${about.kind}, ${about.length.toFixed(1)} × ${about.width.toFixed(1)} m`),
    fact("speed", s && Number.isFinite(s.v) ? `${s.v.toFixed(1)} m/s` : "–"),
    fact("acceleration", `${acceleration} m/s²`),
    i > 0 ? fact("TTC to the AV", ttc === null ? "–" : `${ttc >= NO_RISK ? "≥ " : ""}${ttc.toFixed(2)} s`) : null,
    s && logged ? fact("from the log", `${Math.hypot(s.x - logged.x, s.y - logged.y).toFixed(1)} m`) : null,
    part.states[i][t] ? fact("state", LOOKS[part.states[i][t]].name) : null,
  ].filter(Boolean));
}
