// The visible part of the plane.

export class Camera {
  /** Centre of the view, metres; scale in pixels per metre. */
  x = 0;
  y = 0;
  scale = 6;
  /** Size of the view, CSS pixels. */
  width = 1;
  height = 1;

  toScreen(x, y) {
    return [(x - this.x) * this.scale + this.width / 2, this.height / 2 - (y - this.y) * this.scale];
  }

  toWorld(px, py) {
    return [(px - this.width / 2) / this.scale + this.x, (this.height / 2 - py) / this.scale + this.y];
  }

  /** Zooms around the position of the pointer. */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(80, Math.max(0.8, this.scale * factor));
    const [nx, ny] = this.toWorld(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /** Fits the view to all points, with a margin and a maximum scale. */
  fit(points) {
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const { x, y } of points) {
      left = Math.min(left, x);
      right = Math.max(right, x);
      low = Math.min(low, y);
      high = Math.max(high, y);
    }
    if (!(left <= right && low <= high)) return;
    this.x = (left + right) / 2;
    this.y = (low + high) / 2;
    const margin = 22;
    this.scale = Math.min(11, Math.max(0.8, Math.min(this.width / (right - left + 2 * margin), this.height / (high - low + 2 * margin))));
  }
}
