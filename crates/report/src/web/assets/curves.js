// Curves over time. All share one axis: from the current frame (0 s) to the last.

import { USUAL, spacing } from "./decode.js";
import { colour } from "./palette.js";

const LEFT = 34, RIGHT = 12, TOP = 18, BOTTOM = 6;

/** Clears a canvas and matches its resolution to the screen; the context is in CSS pixels. */
export function sharp(canvas) {
  const ratio = devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  return { c, width, height };
}

/** Calls `seek` with the frame under the pointer while it is dragged. */
export function seekable(canvas, frameAt, seek) {
  const at = (event) => seek(frameAt(event.offsetX, canvas.clientWidth));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    at(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) at(event);
  });
}

export class Chart {
  constructor(canvas, { title, unit, top, floor = 0, line = null, cap = Infinity }, seek) {
    Object.assign(this, { canvas, title, unit, top, floor, line, cap });
    this.axis = USUAL;
    const frameAt = (x, width) => this.axis.now + ((x - LEFT) / (width - LEFT - RIGHT)) * (this.axis.frames - 1 - this.axis.now);
    seekable(canvas, (x, width) => Math.min(this.axis.frames - 1, Math.max(this.axis.now, frameAt(x, width))), seek);
  }

  /** Draws curves `{ values, colour, dashed, name }` of the frames of an axis with a mark at frame `t`. */
  draw(curves, t, axis) {
    this.axis = axis;
    const { now, frames } = axis;
    const { c, width, height } = sharp(this.canvas);
    if (!width) return;
    const largest = Math.max(...curves.flatMap((k) => k.values.slice(now)).filter((v) => Number.isFinite(v)), 0);
    const top = Math.max(this.floor, this.top ?? Math.ceil((largest * 1.08) / 5) * 5, 1);
    const x = (f) => LEFT + ((f - now) / (frames - 1 - now)) * (width - LEFT - RIGHT);
    const y = (v) => TOP + (1 - Math.min(v, top) / top) * (height - TOP - BOTTOM);
    c.font = "10px system-ui, sans-serif";
    c.lineWidth = 1;
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const v of [0, top / 2, top]) {
      c.strokeStyle = colour("rule");
      c.beginPath();
      c.moveTo(LEFT, Math.round(y(v)) + 0.5);
      c.lineTo(width - RIGHT, Math.round(y(v)) + 0.5);
      c.stroke();
      c.fillStyle = colour("dim");
      c.fillText(String(Math.round(v * 10) / 10), LEFT - 5, y(v));
    }
    for (let f = now; f < frames; f += spacing(frames)) {
      c.beginPath();
      c.moveTo(x(f), y(0));
      c.lineTo(x(f), y(0) + 3);
      c.stroke();
    }
    if (this.line !== null) {
      c.strokeStyle = colour("contact");
      c.globalAlpha = 0.6;
      c.setLineDash([3, 3]);
      c.beginPath();
      c.moveTo(LEFT, y(this.line));
      c.lineTo(width - RIGHT, y(this.line));
      c.stroke();
      c.globalAlpha = 1;
    }
    for (const curve of curves) {
      c.strokeStyle = curve.colour;
      c.lineWidth = curve.dashed ? 1.3 : 1.8;
      c.setLineDash(curve.dashed ? [3, 3] : []);
      c.beginPath();
      let open = false;
      for (let f = now; f < frames; f++) {
        const v = curve.values[f];
        if (Number.isFinite(v)) c[open ? "lineTo" : "moveTo"](x(f), y(v));
        open = Number.isFinite(v);
      }
      c.stroke();
    }
    c.setLineDash([]);
    const f = Math.max(t, now);
    c.strokeStyle = colour("text");
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(x(f), TOP - 3);
    c.lineTo(x(f), height - BOTTOM);
    c.stroke();
    this.caption(c, curves, Math.round(f), x, y);
  }

  /** Draws the title and the current values of the curves. */
  caption(c, curves, f, x, y) {
    c.textBaseline = "alphabetic";
    c.textAlign = "left";
    c.font = "600 11px system-ui, sans-serif";
    c.fillStyle = colour("text");
    c.fillText(this.title, 10, 11);
    let at = 10 + c.measureText(this.title).width + 8;
    c.font = "11px system-ui, sans-serif";
    for (const curve of curves) {
      const v = curve.values[f];
      const number = Number.isFinite(v) ? `${v >= this.cap ? "≥ " : ""}${v.toFixed(1)} ${this.unit}` : "–";
      const text = `${curve.name} ${number}`;
      c.fillStyle = curve.colour;
      c.fillText(text, at, 11);
      at += c.measureText(text).width + 10;
      if (Number.isFinite(v)) {
        c.beginPath();
        c.arc(x(f), y(v), 2.6, 0, 7);
        c.fill();
      }
    }
  }
}
