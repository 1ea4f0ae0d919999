// A drawing context with the interface of a canvas that produces SVG, for papers. It implements only what
// the painter uses.

const escape = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
const short = (v) => String(Math.round(v * 1000) / 1000);

export class Vector {
  fillStyle = "#000";
  strokeStyle = "#000";
  lineWidth = 1;
  globalAlpha = 1;
  lineCap = "butt";
  lineJoin = "miter";
  font = "12px sans-serif";
  textAlign = "left";
  textBaseline = "alphabetic";
  #out = [];
  #matrix = [1, 0, 0, 1, 0, 0];
  #dash = [];
  #d = "";
  #clip = null;
  #saved = [];
  static #names = 0;

  /** The SVG elements drawn so far. */
  toString() {
    return this.#out.join("\n");
  }

  setTransform(a, b, c, d, e, f) {
    this.#matrix = [a, b, c, d, e, f];
  }

  translate(x, y) {
    const [a, b, c, d, e, f] = this.#matrix;
    this.#matrix = [a, b, c, d, a * x + c * y + e, b * x + d * y + f];
  }

  rotate(angle) {
    const [a, b, c, d, e, f] = this.#matrix, [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    this.#matrix = [a * cos + c * sin, b * cos + d * sin, c * cos - a * sin, d * cos - b * sin, e, f];
  }

  save() {
    const { fillStyle, strokeStyle, lineWidth, globalAlpha, lineCap, lineJoin, font, textAlign } = this;
    this.#saved.push([{ fillStyle, strokeStyle, lineWidth, globalAlpha, lineCap, lineJoin, font, textAlign }, this.#matrix, this.#dash, this.#clip]);
  }

  restore() {
    const [properties, matrix, dash, clip] = this.#saved.pop();
    Object.assign(this, properties);
    [this.#matrix, this.#dash, this.#clip] = [matrix, dash, clip];
  }

  setLineDash(dash) {
    this.#dash = dash;
  }

  beginPath() {
    this.#d = "";
  }

  moveTo(x, y) {
    this.#d += `M${short(x)} ${short(y)}`;
  }

  lineTo(x, y) {
    this.#d += `L${short(x)} ${short(y)}`;
  }

  closePath() {
    this.#d += "Z";
  }

  /** A full circle. */
  arc(x, y, r) {
    this.#d += `M${short(x - r)} ${short(y)}a${short(r)} ${short(r)} 0 1 0 ${short(2 * r)} 0a${short(r)} ${short(r)} 0 1 0 ${short(-2 * r)} 0Z`;
  }

  roundRect(x, y, w, h, r) {
    const [a, b] = [short(r), short(-r)];
    this.#d += `M${short(x + r)} ${short(y)}h${short(w - 2 * r)}a${a} ${a} 0 0 1 ${a} ${a}v${short(h - 2 * r)}a${a} ${a} 0 0 1 ${b} ${a}h${short(2 * r - w)}a${a} ${a} 0 0 1 ${b} ${b}v${short(2 * r - h)}a${a} ${a} 0 0 1 ${a} ${b}Z`;
  }

  #common() {
    const clip = this.#clip ? ` clip-path="url(#${this.#clip})"` : "";
    return `transform="matrix(${this.#matrix.map(short).join(" ")})"${this.globalAlpha < 1 ? ` opacity="${short(this.globalAlpha)}"` : ""}${clip}`;
  }

  #path(path, style) {
    const d = path?.d ?? this.#d;
    if (d) this.#out.push(`<path d="${d}" ${style} ${this.#common()}/>`);
  }

  fill(path, rule) {
    const [p, r] = typeof path === "string" ? [null, path] : [path, rule];
    this.#path(p, `fill="${escape(this.fillStyle)}"${r ? ` fill-rule="${r}"` : ""}`);
  }

  stroke(path) {
    const dash = this.#dash.length ? ` stroke-dasharray="${this.#dash.map(short).join(" ")}"` : "";
    this.#path(path, `fill="none" stroke="${escape(this.strokeStyle)}" stroke-width="${short(this.lineWidth)}" stroke-linecap="${this.lineCap}" stroke-linejoin="${this.lineJoin}"${dash}`);
  }

  fillRect(x, y, w, h) {
    this.#out.push(`<rect x="${short(x)}" y="${short(y)}" width="${short(w)}" height="${short(h)}" fill="${escape(this.fillStyle)}" ${this.#common()}/>`);
  }

  /** Clips drawing until the next `restore` to a path, which is in the current coordinates. */
  clip(path) {
    const id = `clip-${Vector.#names++}`;
    this.#out.push(`<clipPath id="${id}"><path d="${path.d}"/></clipPath>`);
    this.#clip = id;
  }

  #text(text, x, y, style) {
    const anchor = { center: "middle", right: "end" }[this.textAlign] ?? "start";
    const [, weight, size] = /^(\d+ )?(\d+)px/.exec(this.font) ?? [null, "", "12"];
    this.#out.push(`<text x="${short(x)}" y="${short(y)}" font-size="${size}"${weight ? ` font-weight="${weight.trim()}"` : ""} text-anchor="${anchor}" ${style} ${this.#common()}>${escape(text)}</text>`);
  }

  fillText(text, x, y) {
    this.#text(text, x, y, `fill="${escape(this.fillStyle)}"`);
  }

  strokeText(text, x, y) {
    this.#text(text, x, y, `fill="none" stroke="${escape(this.strokeStyle)}" stroke-width="${short(this.lineWidth)}" stroke-linejoin="round"`);
  }
}
