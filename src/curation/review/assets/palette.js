// The colours of the style sheet, for canvases. They change with the system's light or dark.

const dark = matchMedia("(prefers-color-scheme: dark)");
let known = new Map();

/** The colour of this name in style.css. */
export function colour(name) {
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return known.get(name);
}

export function onChange(call) {
  dark.addEventListener("change", () => {
    known = new Map();
    call();
  });
}
