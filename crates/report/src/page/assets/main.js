// The page: assembly, addresses and keys.

import { avMetrics, data, runs, scenarios, subjects } from "./data.js";
import { $, el, save, toast } from "./dom.js";
import { figures } from "./figures.js";
import { count } from "./format.js";
import { lead } from "./lead.js";
import { filters, list } from "./list.js";
import { choose } from "./palette.js";
import { chosen, provenance, results } from "./results.js";
import { drawable } from "./scenes.js";
import { studies } from "./studies.js";
import { KEYS, byKey, press, show, state, viewer } from "./viewer.js";

const NAMES = { ArrowLeft: "←", ArrowRight: "→", " ": "space" };

/**
 * Shows the scene in the address, `#scenario=…&t=…&left=…&right=…`. Returns false if the address has no
 * scenario of this page.
 */
function follow() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const id = asked.get("scenario");
  if (id === null) return false;
  const index = scenarios.id.indexOf(id);
  if (index < 0) {
    toast(`there is no scenario ${id} in this page`);
    return false;
  }
  const t = Number(asked.get("t") ?? 0);
  const right = asked.get("right");
  show(index, { t: Number.isFinite(t) ? t : 0, left: asked.has("left") ? byKey(asked.get("left")) : null, right: right === null ? undefined : right === "" ? null : byKey(right) });
  return true;
}

let written = "";

/** Writes the state of the page to the address, so that it can be shared. */
function remember() {
  const all = { ...state() ?? {}, ...chosen(), ...filters() };
  // An empty side of the viewer has a meaning.
  const kept = Object.entries(all).filter(([key, v]) => v !== "" || ["left", "right"].includes(key));
  written = `#${new URLSearchParams(kept)}`;
  history.replaceState(null, "", written);
}

/** Citation of the benchmark that defines protocol and metrics. */
const BENCHMARK = `@misc{reactsimbench,
  title = {{ReactSim-Bench}: Benchmarking Reactive Behavior World Model Simulation in Autonomous Driving},
  author = {Zhang, Zhiyuan and Peng, Yanlun and Zhang, Jianing and Guo, Xianda and Huang, Zehan and Liu, Haoran and Li, Qifeng and Zhang, Shaofeng and Jia, Xiaosong and Yan, Junchi},
}
`;

/** A citation of these results, and of the benchmark. */
function bibtex() {
  const p = runs[0].summary.provenance;
  return `@misc{reactsim,
  title = {reactsim: do simulated road users respond feasibly when the autonomous vehicle leaves its log?},
  note = {Version ${p.version}, commit ${p.commit}; seed ${p.settings.seed}; scenarios (BLAKE3) ${p.scenarios_blake3}},
}

${BENCHMARK}`;
}

function downloads() {
  const button = (name, text) => el("button", { onclick: () => save(name, text) }, name);
  $("downloads").replaceChildren(...data.downloads.map((d) => button(d.name, d.text)), button("results.bib", bibtex()));
}

let theme = "";
function turnTheme() {
  theme = { "": "dark", dark: "light", light: "" }[theme];
  choose(theme);
  $("theme").textContent = { "": "auto", dark: "dark", light: "light" }[theme];
}

function keys() {
  $("help-keys").replaceChildren(...KEYS.flatMap(([names, text]) => [
    el("dt", {}, ...names.map((n) => el("kbd", {}, n.split(" ").map((k, i, all) => (all.length > 1 && k === "" ? "" : NAMES[k] ?? k)).join(" ").trim() || "space"))), el("dd", {}, text)]));
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (event.key === "?") return $("help").showModal();
    // Elements with their own keys keep them.
    const own = event.target.closest?.("input, select, textarea, #list");
    const isPressed = event.target.closest?.("button, a, label") && [" ", "Enter"].includes(event.key);
    if (own || isPressed) return;
    if (press(event)) event.preventDefault();
  });
}

function begin() {
  document.title = `${runs[0].name}${runs.length > 1 ? ` and ${runs.length - 1} more` : ""} · reactsim`;
  $("runs").textContent = runs.map((r) => r.name).join(", ");
  const abouts = runs.map((r) => el("p", {}, runs.length > 1 ? el("b", {}, `${r.name}: `) : null, r.about));
  $("about").replaceChildren(...(runs.length > 3 ? [el("details", {}, el("summary", {}, count(runs.length, "run")), ...abouts)] : abouts));
  if (avMetrics.length) $("h-results").textContent = "How do planners drive among simulated road users?";
  // A long table is folded.
  $("events-fold").open = subjects.length <= 12;
  $("stage-note").dataset.lacks = data.lacks.join(" ");
  const asked = new URLSearchParams(location.hash.slice(1));
  results(asked, remember);
  figures();
  studies();
  provenance();
  downloads();
  viewer(remember);
  list(asked, (i) => show(i), remember);
  lead((scenario, t, left, right) => {
    show(scenario, { t, left, right });
    $("viewer").scrollIntoView();
  });
  keys();
  $("theme").onclick = turnTheme;
  $("help-button").onclick = () => $("help").showModal();
  $("help-close").onclick = () => $("help").close();
  addEventListener("hashchange", () => {
    if (location.hash !== written) follow();
  });
  if (!follow()) {
    const first = scenarios.id.findIndex((_, i) => drawable(i));
    if (first >= 0) show(first);
    else {
      $("stage-note").hidden = false;
      $("stage-note").textContent = `There are no scenes here. ${data.lacks.join(" ")}`;
    }
  } else $("viewer").scrollIntoView();
  document.body.dataset.ready = "yes";
}

begin();
