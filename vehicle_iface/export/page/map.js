// The map: paths, tracks and vehicles seen from above, to scale. A click goes to the nearest place of the first track.

const MAP_MARGIN = 18;
const MAP_LEAST_M = 8;
const FOLLOW_M = 40;

class PathMap {
  constructor(box, view) {
    this.view = view;
    this.canvas = box.querySelector("canvas");
    this.follow = box.querySelector("#follow");
    this.drives = view.page.drives.filter((drive) => drive.track);
    this.bounds = this.findBounds();
    box.hidden = !this.bounds;
    this.follow.addEventListener("change", () => this.draw());
    this.canvas.addEventListener("click", (event) => this.select(event));
  }

  findBounds() {
    const bounds = { left: Infinity, right: -Infinity, bottom: Infinity, top: -Infinity };
    const add = (xs, ys) => {
      for (let i = 0; i < xs.length; i++) {
        if (Number.isNaN(xs[i]) || Number.isNaN(ys[i])) continue;
        bounds.left = Math.min(bounds.left, xs[i]);
        bounds.right = Math.max(bounds.right, xs[i]);
        bounds.bottom = Math.min(bounds.bottom, ys[i]);
        bounds.top = Math.max(bounds.top, ys[i]);
      }
    };
    for (const { track } of this.drives) {
      add(track.x, track.y);
      add(track.paths.x, track.paths.y);
    }
    return bounds.left <= bounds.right ? bounds : null;
  }

  /** Pixels per metre, and the point that is shown in the middle. */
  frame(width, height) {
    const { left, right, bottom, top } = this.bounds;
    const across = (width - 2 * MAP_MARGIN) / Math.max(right - left, MAP_LEAST_M);
    const along = (height - 2 * MAP_MARGIN) / Math.max(top - bottom, MAP_LEAST_M);
    const whole = Math.min(across, along);
    const places = this.drives.map(({ track }, number) => {
      const row = this.view.placeOf(this.drives[number]);
      return { x: track.x[row], y: track.y[row] };
    });
    const followed = places.find(({ x, y }) => Number.isFinite(x + y));
    if (!this.follow.checked || !followed) return { scale: whole, x: (left + right) / 2, y: (bottom + top) / 2 };
    return { scale: Math.max(whole, Math.min(width, height) / FOLLOW_M), ...followed };
  }

  draw() {
    if (!this.bounds) return;
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    const frame = this.frame(width, height);
    this.toPixel = (x, y) => [width / 2 + (x - frame.x) * frame.scale, height / 2 - (y - frame.y) * frame.scale];
    const context = this.canvas.getContext("2d");
    const key = [width, height, ratio, frame.scale, frame.x, frame.y, color("ground"), this.view.axis].join();
    if (key !== this.drawnKey) {
      this.drawnKey = key;
      this.ground = element("canvas");
      this.ground.width = Math.round(width * ratio);
      this.ground.height = Math.round(height * ratio);
      const below = this.ground.getContext("2d");
      below.scale(ratio, ratio);
      this.paintGround(below, width, height, frame.scale);
    }
    this.canvas.width = this.ground.width;
    this.canvas.height = this.ground.height;
    context.drawImage(this.ground, 0, 0);
    context.scale(ratio, ratio);
    for (const drive of this.drives) this.paintVehicle(context, drive, frame.scale);
  }

  paintGround(context, width, height, scale) {
    context.lineJoin = "round";
    for (const { track } of this.drives) this.paintLine(context, track.paths.x, track.paths.y, color("path"), 5);
    for (const drive of this.drives) this.paintLine(context, drive.track.x, drive.track.y, color(drive.color), 1.6);
    for (const drive of this.drives) {
      context.fillStyle = color("limit");
      for (const event of drive.events) {
        if (event.kind !== "stop" || event.phase === "ended") continue;
        const row = lastAt(drive.time, event.at_s);
        if (row < 0 || Number.isNaN(drive.track.x[row])) continue;
        context.beginPath();
        context.arc(...this.toPixel(drive.track.x[row], drive.track.y[row]), 4, 0, 2 * Math.PI);
        context.fill();
      }
    }
    const length = roundTicks(0, (0.35 * width) / scale, 3).at(-1).at;
    context.strokeStyle = context.fillStyle = color("soft");
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(10, height - 10);
    context.lineTo(10 + length * scale, height - 10);
    context.stroke();
    context.font = FONT;
    context.fillText(`${length} m`, 12, height - 15);
  }

  paintLine(context, xs, ys, stroke, width) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    let isDrawn = false;
    let [beforeX, beforeY] = [NaN, NaN];
    for (let i = 0; i < xs.length; i++) {
      if (Number.isNaN(xs[i]) || Number.isNaN(ys[i])) {
        isDrawn = false;
        continue;
      }
      const [x, y] = this.toPixel(xs[i], ys[i]);
      if (isDrawn && Math.abs(x - beforeX) + Math.abs(y - beforeY) < 0.7) continue;
      if (isDrawn) context.lineTo(x, y);
      else context.moveTo(x, y);
      [isDrawn, beforeX, beforeY] = [true, x, y];
    }
    context.stroke();
  }

  paintVehicle(context, drive, scale) {
    const { track } = drive;
    const row = this.view.placeOf(drive);
    if (row < 0 || Number.isNaN(track.x[row]) || Number.isNaN(track.heading[row])) return;
    const grow = Math.max(1, 16 / (track.length_m * scale));
    context.save();
    context.translate(...this.toPixel(track.x[row], track.y[row]));
    context.rotate(-track.heading[row]);
    context.scale(scale * grow, scale * grow);
    context.globalAlpha = this.drives.length > 1 ? 0.7 : 1;
    context.fillStyle = color(drive.color);
    context.strokeStyle = color("ground");
    context.lineWidth = 1.5 / (scale * grow);
    const [back, front, side] = [-track.rear_overhang_m, track.length_m - track.rear_overhang_m, track.width_m / 2];
    context.beginPath();
    context.moveTo(back, -side);
    context.lineTo(front - 0.8, -side);
    context.lineTo(front, 0);
    context.lineTo(front - 0.8, side);
    context.lineTo(back, side);
    context.closePath();
    context.fill();
    context.stroke();
    context.restore();
  }

  select(event) {
    const box = this.canvas.getBoundingClientRect();
    const drive = this.drives[0];
    const { x, y } = drive.track;
    let [nearest, least] = [-1, Infinity];
    for (let i = 0; i < x.length; i++) {
      const [px, py] = this.toPixel(x[i], y[i]);
      const distance = Math.hypot(px - event.clientX + box.left, py - event.clientY + box.top);
      if (distance < least) [nearest, least] = [i, distance];
    }
    if (nearest >= 0) this.view.setCursor(this.view.axisOf(drive)[nearest]);
  }
}
