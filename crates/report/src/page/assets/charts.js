// Charts as SVG that can be saved.

import { el, save, svg } from "./dom.js";
import { colour } from "./palette.js";

const WIDTH = 560, HEIGHT = 340;
const EDGE = { left: 62, right: 16, top: 40, bottom: 48 };

/** Round numbers within a range. */
export function ticks(min, max, count = 6) {
  const raw = (max - min) / count || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= raw);
  const out = [];
  for (let t = Math.ceil(min / step - 1e-9); t * step <= max + step * 1e-9; t++) out.push(Math.abs(t * step) < step * 1e-9 ? 0 : t * step);
  return out;
}

const tidy = (v) => String(Math.round(v * 1e6) / 1e6).replace("-", "−");

/** An axis: a function from values to pixels, and its tick values. */
function axis({ min, max, marks, log = false }, from, to) {
  const f = log ? Math.log : (v) => v;
  const at = (v) => from + ((f(v) - f(min)) / (f(max) - f(min) || 1)) * (to - from);
  return { at, marks: marks ?? ticks(min, max) };
}

/** Shapes of marks, which distinguish series without colour. */
const SHAPES = [
  (r) => `M${-r} 0A${r} ${r} 0 1 0 ${r} 0A${r} ${r} 0 1 0 ${-r} 0Z`,
  (r) => `M${-r} ${-r}H${r}V${r}H${-r}Z`,
  (r) => `M0 ${-1.2 * r}L${1.1 * r} ${0.8 * r}H${-1.1 * r}Z`,
  (r) => `M0 ${-1.3 * r}L${1.3 * r} 0L0 ${1.3 * r}L${-1.3 * r} 0Z`,
  (r) => `M${-r} ${-r}L${r} ${r}M${-r} ${r}L${r} ${-r}`,
  (r) => `M0 ${-1.3 * r}V${1.3 * r}M${-1.3 * r} 0H${1.3 * r}`,
];

/** A mark at a position. Crosses are stroked, other shapes filled. */
export const mark = (kind, x, y, ink, { r = 3.6, title = null, opacity = 1, ...more } = {}) =>
  svg("path", { d: SHAPES[kind % SHAPES.length](r), transform: `translate(${x.toFixed(2)} ${y.toFixed(2)})`, fill: kind % SHAPES.length < 4 ? ink : "none", stroke: ink, "stroke-width": kind % SHAPES.length < 4 ? 0.5 : 1.8, opacity, ...more },
    title ? svg("title", {}, title) : null);

/**
 * A chart with its frame, legend and a button that saves it. `x` and `y` are axes
 * `{ label, min, max, log, marks }`; `draw` takes the functions from values to pixels and returns
 * elements; `legend` is a list of [name, mark kind or null, colour].
 */
export function chart({ name, title, about, x, y, legend = [], height = HEIGHT, draw }) {
  const h = axis(x, EDGE.left, WIDTH - EDGE.right), v = axis(y, height - EDGE.bottom, EDGE.top);
  const ink = "var(--text)", dim = "var(--dim)";
  const picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${height}`, class: "chart", role: "img", "aria-label": `${title}. ${about}`, "data-chart": name, "font-family": "system-ui, Helvetica, Arial, sans-serif" },
    svg("rect", { width: WIDTH, height, fill: "var(--panel)" }),
    svg("text", { x: 14, y: 21, "font-size": 14, "font-weight": 600, fill: ink }, title));
  for (const t of v.marks) {
    picture.append(
      svg("line", { x1: EDGE.left, x2: WIDTH - EDGE.right, y1: v.at(t), y2: v.at(t), stroke: "var(--rule)" }),
      svg("text", { x: EDGE.left - 7, y: v.at(t) + 4, "font-size": 11, "text-anchor": "end", fill: dim }, y.text?.(t) ?? tidy(t)));
  }
  for (const t of h.marks) {
    picture.append(
      svg("line", { x1: h.at(t), x2: h.at(t), y1: height - EDGE.bottom, y2: height - EDGE.bottom + 4, stroke: dim }),
      svg("text", { x: h.at(t), y: height - EDGE.bottom + 17, "font-size": 11, "text-anchor": "middle", fill: dim }, x.text?.(t) ?? tidy(t)));
  }
  picture.append(
    svg("line", { x1: EDGE.left, x2: WIDTH - EDGE.right, y1: height - EDGE.bottom, y2: height - EDGE.bottom, stroke: dim }),
    svg("text", { x: (EDGE.left + WIDTH - EDGE.right) / 2, y: height - 10, "font-size": 12, "text-anchor": "middle", fill: ink }, x.label),
    svg("text", { transform: `translate(16 ${(height - EDGE.bottom + EDGE.top) / 2}) rotate(-90)`, "font-size": 12, "text-anchor": "middle", fill: ink }, y.label));
  picture.append(...draw(h.at, v.at));
  const key = el("ul", { class: "key" }, ...legend.map(([text, kind, tint]) =>
    el("li", {}, svg("svg", { width: 18, height: 12, "aria-hidden": "true" }, kind === null ? svg("rect", { x: 2, y: 2, width: 14, height: 8, fill: tint, opacity: 0.6 }) : mark(kind, 9, 6, tint)), text)));
  return el("figure", { class: "card" }, picture, key,
    el("figcaption", {}, about, " ", el("button", { class: "plain", onclick: () => save(`${name}.svg`, standalone(picture, legend, height), "image/svg+xml") }, "save SVG")));
}

/** The chart as an SVG file with the current colours and the legend. */
export function standalone(picture, legend, height) {
  const copy = picture.cloneNode(true);
  const rows = legend.length;
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("viewBox", `0 0 ${WIDTH} ${height + 18 * rows + (rows ? 8 : 0)}`);
  copy.firstElementChild.setAttribute("height", height + 18 * rows + 8);
  legend.forEach(([text, kind, tint], i) => {
    const y = height + 8 + 18 * i;
    copy.append(kind === null ? svg("rect", { x: EDGE.left, y: y - 4, width: 14, height: 8, fill: tint, opacity: 0.6 }) : mark(kind, EDGE.left + 7, y, tint),
      svg("text", { x: EDGE.left + 22, y: y + 4, "font-size": 12, fill: "var(--text)" }, text));
  });
  for (const element of [copy, ...copy.querySelectorAll("*")]) {
    for (const name of ["fill", "stroke"]) {
      const variable = /^var\(--(.+)\)$/.exec(element.getAttribute(name) ?? "");
      if (variable) element.setAttribute(name, colour(variable[1]));
    }
  }
  return new XMLSerializer().serializeToString(copy);
}

/** A line through points `[x, y, low, high, title]` with intervals. */
export function series(points, kind, ink, h, v) {
  const line = points.map(([x, y], i) => `${i ? "L" : "M"}${h(x).toFixed(2)} ${v(y).toFixed(2)}`).join("");
  return [
    svg("path", { d: line, fill: "none", stroke: ink, "stroke-width": 1.8 }),
    ...points.filter(([, , low]) => low !== null).map(([x, , low, high]) => svg("line", { x1: h(x), x2: h(x), y1: v(low), y2: v(high), stroke: ink, opacity: 0.45 })),
    ...points.map(([x, y, , , title]) => mark(kind, h(x), v(y), ink, { r: 4, title, "data-x": x, "data-y": y })),
  ];
}

/** Outline of a histogram over equal bins `[from, share]`. */
export function steps(bins, width, ink, h, v, floor = 0) {
  let d = `M${h(bins[0][0])} ${v(floor)}`;
  for (const [from, share] of bins) d += `V${v(share).toFixed(2)}H${h(from + width).toFixed(2)}`;
  return svg("path", { d: `${d}V${v(floor)}Z`, fill: ink, "fill-opacity": 0.22, stroke: ink, "stroke-width": 1.6 });
}
