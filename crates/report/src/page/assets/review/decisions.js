// Decisions, kept by the browser under the digest of the file of candidates, and their export.

import { $, save } from "./dom.js";

/** Data written by src/page/review.rs. */
export const data = JSON.parse($("data").textContent);

const KEY = `reactsim review ${data.digest}`;

/** Name of the reviewer, decisions by id of the scenario, and what each decision replaced. */
let kept = { reviewer: null, lines: {}, replaced: [] };

function load() {
  try {
    kept = JSON.parse(localStorage.getItem(KEY)) ?? kept;
  } catch {
    // The next decision reports that this browser keeps nothing.
  }
}
load();

/** Calls `changed` when another page of the same file changes the decisions. */
export function onChange(changed) {
  addEventListener("storage", (event) => {
    if (event.key !== KEY) return;
    load();
    changed();
  });
}

function keep() {
  try {
    localStorage.setItem(KEY, JSON.stringify(kept));
    $("alarm").hidden = true;
  } catch (error) {
    $("alarm").hidden = false;
    $("alarm").textContent = `This browser does not keep decisions: export them before you close the page. (${error.message})`;
  }
}

export const reviewer = () => kept.reviewer;

export function setReviewer(name) {
  kept.reviewer = name;
  keep();
}

/** The decision about a scenario; undefined if there is none. */
export const decision = (id) => kept.lines[id];

function put(id, line) {
  if (line) kept.lines[id] = line;
  else delete kept.lines[id];
  keep();
}

/** Records a decision about a scenario; null withdraws it. */
export function decide(id, line) {
  kept.replaced.push([id, kept.lines[id] ?? null]);
  put(id, line);
}

/** Undoes the last decision; returns the id of its scenario, or undefined if there is none. */
export function undo() {
  const last = kept.replaced.pop();
  if (last) put(...last);
  return last?.[0];
}

/** Saves all decisions about the file to a file, one per line, for `reactsim curate apply`. */
export function exportAll() {
  const lines = Object.values(kept.lines);
  save(`${data.file}.decisions.jsonl`, lines.map((line) => `${JSON.stringify(line)}\n`).join(""));
  return lines.length;
}
