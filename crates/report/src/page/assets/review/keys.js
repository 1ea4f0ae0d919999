// Key bindings. The help list is built from the same table.

import { $, el } from "./dom.js";

/**
 * Returns the bindings: values of KeyboardEvent.key (a leading `!` requires shift), description, action, and
 * whether the action ignores key repeat, so that holding a key down does not decide many scenarios.
 */
export function table(act) {
  return [
    [["j", "ArrowDown"], "next candidate", () => act.select(1)],
    [["k", "ArrowUp"], "previous candidate", () => act.select(-1)],
    [["a", "p"], "accept the selected candidate", act.pick, true],
    [["x"], "reject the scenario: no candidate fits", act.rejectScenario, true],
    [["X"], "reject the selected candidate only", act.rejectCandidate, true],
    [["f"], "flag for another look, with a note", act.flag, true],
    [["d"], "drop the decision about the scenario", act.clear, true],
    [["u"], "undo the last decision", act.undo, true],
    [["e"], "export all decisions to a file", act.exportAll, true],
    [["n"], "next scenario", () => act.step(1)],
    [["N"], "previous scenario", () => act.step(-1)],
    [["t"], "next scenario to decide", act.nextToDo],
    [["/"], "go to a scenario (number or id)", act.goTo],
    [[" "], "play or pause", act.play],
    [["ArrowLeft"], "one frame back", () => act.frame(-1)],
    [["ArrowRight"], "one frame forward", () => act.frame(1)],
    [["!ArrowLeft"], "one second back", () => act.frame(-10)],
    [["!ArrowRight"], "one second forward", () => act.frame(10)],
    [["0", "Home"], "to step 0", act.rewind],
    [["b"], "to the first contact or close call", act.toConflict],
    [["s"], "replay speed", act.speed],
    [["c"], "responses of the certificate or log replay", act.certificate],
    [["o"], "the other candidates", act.others],
    [["v"], "follow the AV", act.follow],
    [["r"], "show everything", act.fit],
    [["+", "="], "zoom in", () => act.zoom(1.25)],
    [["-"], "zoom out", () => act.zoom(0.8)],
    [["?"], "this help", act.help],
  ];
}

const NAMES = { ArrowDown: "↓", ArrowUp: "↑", ArrowLeft: "←", ArrowRight: "→", " ": "space" };

/** Listens to keys, except those typed into fields or dialogs, and fills the help list. */
export function listen(keys) {
  const find = (event) => {
    const shifted = `!${event.key}`;
    return (event.shiftKey && keys.find(([names]) => names.includes(shifted))) ||
      keys.find(([names]) => names.includes(event.key));
  };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (document.querySelector("dialog[open]") || event.target.matches?.("input, select")) return;
    const found = find(event);
    if (!found) return;
    event.preventDefault();
    // A previously clicked button must not react to space or enter.
    document.activeElement?.blur?.();
    if (!(event.repeat && found[3])) found[2]();
  });
  const name = (key) => NAMES[key] ?? key;
  const shown = (key) => (key.startsWith("!") ? `shift ${name(key.slice(1))}` : name(key));
  $("help-keys").append(...keys.flatMap(([names, text]) =>
    [el("span", {}, ...names.map((key) => el("kbd", {}, shown(key)))), el("span", {}, text)]));
}
