// The colours of palette.css for canvases. They change with the theme of the system or of the page.

const dark = matchMedia("(prefers-color-scheme: dark)");
let known = new Map();
let probe = null;

/** The current colour of this name in palette.css. */
export function colour(name) {
  if (!known.has(name)) {
    // The variable holds both the light and the dark colour; the computed style of an element resolves it.
    probe ??= document.documentElement.appendChild(document.createElement("i"));
    probe.hidden = true;
    probe.style.color = `var(--${name})`;
    known.set(name, getComputedStyle(probe).color);
  }
  return known.get(name);
}

/** Registers a callback for changes of the colours. */
export function onChange(call) {
  const changed = () => {
    known = new Map();
    call();
  };
  dark.addEventListener("change", changed);
  document.addEventListener("theme", changed);
}

/** Sets the theme to light or dark, or leaves it to the system. */
export function choose(theme) {
  if (theme) document.documentElement.dataset.theme = theme;
  else delete document.documentElement.dataset.theme;
  document.dispatchEvent(new Event("theme"));
}
