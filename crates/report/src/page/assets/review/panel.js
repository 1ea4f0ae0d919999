// The panel next to the views: the decision, the candidates, and the figures of the selected one.

import { el } from "./dom.js";
import { colour } from "./palette.js";

/** Creates an element with classes and content. */
const make = (tag, classes, ...content) => el(tag, { class: classes || null }, ...content);

/** Formats a number with fixed decimals; a dash if there is none. */
const number = (value, decimals = 1) =>
  (Number.isFinite(value) ? value.toFixed(decimals).replace(/^-(0\.?0*)$/, "$1") : "–");
const signed = (value, decimals = 1) =>
  (Number.isFinite(value) && value > 0 ? "+" : "") + number(value, decimals);

/** Formats a figure with two to three significant digits. */
const figure = (value) => number(value, Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2);

/** Returns the figure of the filter that rejected a candidate. */
const decisive = (candidate) =>
  candidate.figures.find((f) => f.filter === candidate.rejected_by)?.value ?? null;

const WORDS = { pick: "accepted", reject: "rejected", flag: "flagged" };

/** Describes a decision in words, such as `accepted #3`. */
export function words(line) {
  const what = WORDS[line.decision] ?? line.decision;
  if (line.candidate !== null) return `${what} #${line.candidate}`;
  return line.decision === "reject" ? "rejected the scenario" : what;
}

/** Shows the decision about the scenario, and its reviewer. */
export function verdict(element, line) {
  if (!line) return element.replaceChildren(make("div", "dim", "undecided"));
  const time = line.at.replace("T", " ").slice(0, 16);
  const mark = make("span", `mark ${line.decision}`, words(line));
  element.replaceChildren(make("div", "", mark, make("span", "dim", `${line.reviewer} · ${time} UTC`)));
  if (line.note) element.append(make("div", "", `“${line.note}”`));
}

/** Lists the candidates; `choose` is called with the clicked one. */
export function candidates(element, scenario, selected, line, choose) {
  element.replaceChildren();
  for (const candidate of scenario.candidates) {
    const row = make("div", "candidate");
    row.setAttribute("role", "option");
    row.dataset.number = candidate.number;
    row.classList.toggle("selected", candidate === selected);
    row.setAttribute("aria-selected", candidate === selected);
    row.classList.toggle("rejected", !!candidate.rejected_by);
    const stripe = make("span", "stripe");
    stripe.style.background = colour(candidate.category);
    const badges = make("span", "");
    if (candidate.chosen) badges.append(make("span", "badge dim", "chosen"));
    if (line && line.candidate === candidate.number) {
      badges.append(make("span", `badge ${line.decision}`, WORDS[line.decision] ?? ""));
    }
    const value = decisive(candidate);
    const why = candidate.rejected_by
      ? `${candidate.rejected_by}${value === null ? "" : ` ${figure(value)}`}`
      : candidate.category;
    row.append(
      stripe,
      make("span", "order", `#${candidate.number}`),
      make("span", "what", candidate.maneuver),
      badges,
      make("span", "why", why),
      make("span", "score", candidate.rejected_by ? "✗" : number(candidate.score, 2)),
    );
    row.title = candidate.reason || candidate.maneuver;
    row.addEventListener("click", () => choose(candidate));
    element.append(row);
    if (candidate === selected) row.scrollIntoView?.({ block: "nearest" });
  }
}

/** Creates a label with a value. */
const fact = (label, value) => make("span", "", `${label} `, make("b", "", value));

function cues(c) {
  const rows = [
    fact("category", c.category),
    fact("intent", c.intent ?? "–"),
    fact("lateral", `${signed(c.lateral_offset)} m`),
    fact("along", `${signed(c.longitudinal_offset)} m`),
    fact("heading", `${number(c.heading_change, 0)}°`),
  ];
  if (c.other_branch) rows.push(fact("route", "another branch"));
  if (c.conflict_step !== null) rows.push(fact("first conflict", `${number(c.conflict_step / 10)} s`));
  if (c.difficulty) {
    rows.push(fact("difficulty", c.difficulty));
    rows.push(fact("required braking", `${number(c.required_deceleration)} m/s²`));
    if (c.time_to_react !== null) rows.push(fact("time to react", `${number(c.time_to_react)} s`));
    if (c.needs_swerve) rows.push(fact("swerve", "required"));
  }
  rows.push(fact("ADE", `${number(c.ade)} m`), fact("Δ mean speed", `${signed(c.speed_difference)} m/s`));
  rows.push(
    fact("at fault", String(c.at_fault)),
    fact("overlaps", String(c.overlaps)),
    fact("risky", String(c.risky)),
  );
  rows.push(fact("source", c.source));
  return rows;
}

/** Shows the figures of all filters, and the certificate. */
export function details(element, c) {
  element.replaceChildren();
  if (!c) return;
  element.append(make("h3", "", `#${c.number} ${c.maneuver}`));
  if (c.rejected_by) element.append(make("p", "reason", `${c.rejected_by}: ${c.reason}`));
  element.append(make("div", "facts", ...cues(c)));
  const half = Math.ceil(c.figures.length / 2);
  const parts = [c.figures.slice(0, half), c.figures.slice(half)].filter((part) => part.length);
  const columns = parts.map((part) => {
    const body = make("tbody", "");
    for (const { filter, value, passed } of part) {
      const row = make("tr", passed === false ? "failed" : passed === null ? "unasked" : "");
      row.append(
        make("td", "mark", passed === null ? "·" : passed ? "✓" : "✗"),
        make("td", "", filter),
        make("td", "value", value === null ? "–" : figure(value)),
      );
      if (passed === null) row.title = "skipped: already rejected";
      body.append(row);
    }
    return make("table", "", body);
  });
  element.append(make("div", "figures", ...columns));
  if (!c.certificate) return;
  const text = c.certificate.length
    ? "certificate: how the conflict can be avoided"
    : "certificate: no agent has to react";
  element.append(make("h3", "", text));
  for (const r of c.certificate) {
    const how = [`from ${number(r.reaction_step / 10)} s`, `braking ${number(r.peak_deceleration)} m/s²`];
    if (r.nudge) how.push(`${number(Math.abs(r.nudge))} m to the ${r.nudge > 0 ? "left" : "right"}`);
    how.push(`clear by ${number(r.clearance, 2)} m`);
    element.append(make("div", "dim", make("b", "", r.agent), ` ${how.join(", ")}`));
  }
}

/** Fills the legend of colours. */
export function legend(element) {
  element.replaceChildren();
  const entry = (name, label, box = false) => {
    const sign = make("i", box ? "box" : "");
    sign.style[box ? "background" : "borderColor"] = colour(name);
    element.append(make("span", "", sign, label));
  };
  entry("longitudinal", "longitudinal");
  entry("lateral", "lateral");
  entry("directional", "directional");
  entry("accent", "log");
  entry("vehicle", "vehicle", true);
  entry("pedestrian", "pedestrian", true);
  entry("cyclist", "cyclist", true);
  entry("contact", "contact", true);
  entry("risky", "TTC < 0.5 s", true);
  entry("response", "certificate's response", true);
}
