// The colours of palette.css, for canvases. They change with the system's light or dark, or with the page's own choice.

const dark = matchMedia("(prefers-color-scheme: dark)");
let known = new Map();
let probe = null;

/** The colour of this name in palette.css, as it is now. */
export function colour(name) {
  if (!known.has(name)) {
    // The variable itself holds both the light colour and the dark one; an element that has it knows which.
    probe ??= document.documentElement.appendChild(document.createElement("i"));
    probe.hidden = true;
    probe.style.color = `var(--${name})`;
    known.set(name, getComputedStyle(probe).color);
  }
  return known.get(name);
}

/** Calls when the colours have changed. */
export function onChange(call) {
  const changed = () => {
    known = new Map();
    call();
  };
  dark.addEventListener("change", changed);
  document.addEventListener("theme", changed);
}

/** Chooses light or dark, or leaves it to the system. */
export function choose(theme) {
  if (theme) document.documentElement.dataset.theme = theme;
  else delete document.documentElement.dataset.theme;
  document.dispatchEvent(new Event("theme"));
}
