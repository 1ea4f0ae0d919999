// The time bar, which also covers the history.

import { seekable, sharp } from "./curves.js";
import { USUAL, spacing } from "./decode.js";
import { colour } from "./palette.js";

/** The time bar under the view, with marks where an agent touches the AV or comes close. */
export class Scrub {
  constructor(canvas, seek) {
    [this.canvas, this.axis] = [canvas, USUAL];
    const frame = (x, width) => Math.min(this.axis.frames - 1, Math.max(0, ((x - 8) / (width - 16)) * (this.axis.frames - 1)));
    seekable(canvas, frame, seek);
  }

  /** Draws the bar of the frames of an axis with a mark at frame `t`. */
  draw(analysis, t, axis) {
    this.axis = axis;
    const { now, frames } = axis;
    const { c, width, height } = sharp(this.canvas);
    if (!width) return;
    const x = (f) => 8 + (f / (frames - 1)) * (width - 16);
    const y = 9, thick = 5;
    c.fillStyle = colour("rule");
    c.fillRect(x(0), y, x(frames - 1) - x(0), thick);
    c.fillStyle = colour("center");
    c.fillRect(x(0), y, x(now) - x(0), thick);
    for (let f = now; f < frames; f++) {
      const mark = analysis?.touching[f]?.size ? "contact" : analysis?.risky[f]?.size ? "risky" : null;
      if (!mark) continue;
      c.fillStyle = colour(mark);
      c.fillRect(x(f - 0.5), y, x(f + 0.5) - x(f - 0.5) + 0.5, thick);
    }
    c.font = "10px system-ui, sans-serif";
    c.textAlign = "center";
    const every = spacing(frames);
    for (let f = now % every; f < frames; f += every) {
      c.fillStyle = colour("dim");
      c.fillRect(Math.round(x(f)), y + thick + 1, 1, 3);
      c.fillText(`${(f - now) / 10}`, x(f), height - 3);
    }
    c.fillStyle = colour("text");
    c.beginPath();
    c.arc(x(t), y + thick / 2, 6, 0, 7);
    c.fill();
  }
}
