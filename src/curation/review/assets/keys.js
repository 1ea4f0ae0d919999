// Keys and what they do. The list of help is made of the same table.

/** Values of KeyboardEvent.key (a leading `!` asks for shift), what they are for, what they do, and whether that is done once only while a
 * key is held down: nobody should decide about many scenarios by leaning on a key. */
export function table(act) {
  return [
    [["j", "ArrowDown"], "next candidate", () => act.select(1)],
    [["k", "ArrowUp"], "previous candidate", () => act.select(-1)],
    [["p"], "pick the selected candidate", act.pick, true],
    [["x"], "reject the scenario: no candidate fits", act.rejectScenario, true],
    [["X"], "reject the selected candidate only", act.rejectCandidate, true],
    [["f"], "flag, to look at again", act.flag, true],
    [["F"], "flag with a note", act.flagWithNote, true],
    [["d"], "drop your decision about the scenario", act.clear, true],
    [["u"], "undo the last decision", act.undo, true],
    [["n"], "next scenario", () => act.step(1)],
    [["N"], "previous scenario", () => act.step(-1)],
    [["t"], "next scenario to decide", act.nextToDo],
    [["/"], "go to a scenario (number or id)", act.goTo],
    [[" "], "play or pause", act.play],
    [["ArrowLeft"], "a frame back", () => act.frame(-1)],
    [["ArrowRight"], "a frame on", () => act.frame(1)],
    [["!ArrowLeft"], "a second back", () => act.frame(-10)],
    [["!ArrowRight"], "a second on", () => act.frame(10)],
    [["0", "Home"], "to step 0", act.rewind],
    [["b"], "to the first contact or close call", act.toConflict],
    [["s"], "speed of the replay", act.speed],
    [["c"], "responses of the certificate or log replay", act.certificate],
    [["l"], "the log's AV", act.ghost],
    [["o"], "the other candidates", act.others],
    [["v"], "follow the AV", act.follow],
    [["r"], "show everything", act.fit],
    [["+", "="], "closer", () => act.zoom(1.25)],
    [["-"], "farther", () => act.zoom(0.8)],
    [["?"], "this help", act.help],
  ];
}

const NAMES = { ArrowDown: "↓", ArrowUp: "↑", ArrowLeft: "←", ArrowRight: "→", " ": "space" };

/** Listens. Keys typed into fields or dialogs are left alone. */
export function listen(keys) {
  const find = (event) => {
    const shifted = `!${event.key}`;
    return (event.shiftKey && keys.find(([names]) => names.includes(shifted))) || keys.find(([names]) => names.includes(event.key));
  };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (document.querySelector("dialog[open]") || event.target.matches?.("input, select")) return;
    const found = find(event);
    if (!found) return;
    event.preventDefault();
    // A button that was clicked before must not be pressed by space or enter.
    document.activeElement?.blur?.();
    if (!(event.repeat && found[3])) found[2]();
  });
}

/** Fills the list of help. */
export function fill(element, keys) {
  for (const [names, text] of keys) {
    const cell = document.createElement("span");
    for (const name of names) {
      const key = document.createElement("kbd");
      key.textContent = name.startsWith("!") && name.length > 1 ? `shift ${NAMES[name.slice(1)] ?? name.slice(1)}` : NAMES[name] ?? name;
      cell.append(key);
    }
    const what = document.createElement("span");
    what.textContent = text;
    element.append(cell, what);
  }
}
