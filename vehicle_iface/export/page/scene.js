// The scene: the drive in perspective, painted on a canvas from far to near. A drag turns it, Ctrl + wheel zooms.

const SCENE_START = { yaw: 0.8, pitch: 0.5, distance: 16 };
const SCENE_NEAR = 0.5;
const THIN_M = 0.3;
const POST_M = 2.3;
const LIGHT = [0.3, 0.5, 0.81];
const GRID_LINES = 20;

class Scene {
  constructor(box, view, bounds) {
    this.view = view;
    this.bounds = bounds;
    this.canvas = box.querySelector("canvas");
    this.look = box.querySelector("#look");
    this.drives = view.page.drives.filter((drive) => drive.track);
    box.hidden = !bounds;
    this.lines = this.drives.map(({ track }) => ({
      path: thinOut(track.paths.x, track.paths.y),
      track: thinOut(track.x, track.y),
    }));
    this.reset();
    this.look.addEventListener("change", () => this.reset());
    this.listen();
  }

  /** The usual view of the chosen camera. */
  reset() {
    Object.assign(this, SCENE_START);
    if (this.look.value === "behind") Object.assign(this, { yaw: 0, pitch: 0.3 });
    if (this.look.value === "whole" && this.bounds) {
      const { left, right, bottom, top } = this.bounds;
      Object.assign(this, { yaw: Math.PI / 2, pitch: 1, distance: 1.5 * Math.max(right - left, top - bottom, 20) });
    }
    this.draw();
  }

  listen() {
    const { canvas } = this;
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      from = event;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      this.yaw -= (event.clientX - from.clientX) / 150;
      this.pitch = Math.min(Math.max(this.pitch + (event.clientY - from.clientY) / 150, 0.05), 1.55);
      from = event;
      this.draw();
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => (from = null));
    canvas.addEventListener("dblclick", () => this.reset());
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.distance = Math.min(Math.max(this.distance * Math.exp(event.deltaY / 400), 4), 5000);
      this.draw();
    });
  }

  /** Where a drive's vehicle is at the cursor; null where that is unknown. */
  placeOf(drive) {
    const row = this.view.placeOf(drive);
    const { x, y, heading, reference_x: rx, reference_y: ry } = drive.track;
    if (row < 0 || !Number.isFinite(x[row] + y[row] + heading[row])) return null;
    return { x: x[row], y: y[row], heading: heading[row], rx: rx[row], ry: ry[row] };
  }

  draw() {
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!this.bounds || !width) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    context.lineJoin = "round";
    const places = this.drives.map((drive) => this.placeOf(drive));
    this.aim(places.find(Boolean), width, height);
    this.paintGrid(context, height);
    for (const { path } of this.lines) this.paintLine(context, path, color("path"), 5);
    this.drives.forEach((drive, k) => this.paintLine(context, this.lines[k].track, color(drive.color), 1.6));
    const shown = this.drives.flatMap((drive, k) => (places[k] ? [{ drive, place: places[k] }] : []));
    shown.sort((a, b) => this.depth([b.place.x, b.place.y, 0]) - this.depth([a.place.x, a.place.y, 0]));
    for (const { drive, place } of shown) {
      this.paintVehicle(context, drive, place);
      this.paintReference(context, place);
    }
  }

  /** Puts the camera in its place: behind what it looks at, which is the last known place of the vehicle. */
  aim(place, width, height) {
    const { left, right, bottom, top } = this.bounds;
    if (place) this.last = place;
    const isWhole = this.look.value === "whole" || !this.last;
    this.target = isWhole ? [(left + right) / 2, (bottom + top) / 2, 0] : [this.last.x, this.last.y, 0.8];
    const yaw = this.yaw + (this.look.value === "behind" && this.last ? this.last.heading : 0);
    const [cosY, sinY, cosP, sinP] = [Math.cos(yaw), Math.sin(yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    this.ahead = [cosP * cosY, cosP * sinY, -sinP];
    this.right = [sinY, -cosY, 0];
    this.up = [sinP * cosY, sinP * sinY, cosP];
    this.eye = this.target.map((at, k) => at - this.distance * this.ahead[k]);
    Object.assign(this, { middleX: width / 2, middleY: height / 2, focal: 1.1 * height });
  }

  depth(point) {
    return dot(minusOf(point, this.eye), this.ahead);
  }

  /** Pixel of a point in front of the camera. */
  project(point) {
    const seen = minusOf(point, this.eye);
    const scale = this.focal / dot(seen, this.ahead);
    return [this.middleX + scale * dot(seen, this.right), this.middleY - scale * dot(seen, this.up)];
  }

  /** Adds the part of a line that is in front of the camera. */
  trace(context, a, b) {
    const [near, far] = [this.depth(a), this.depth(b)];
    if (near < SCENE_NEAR && far < SCENE_NEAR) return;
    const cut = (SCENE_NEAR - near) / (far - near);
    const between = () => a.map((at, k) => at + cut * (b[k] - at));
    context.moveTo(...this.project(near < SCENE_NEAR ? between() : a));
    context.lineTo(...this.project(far < SCENE_NEAR ? between() : b));
  }

  paintGrid(context, height) {
    const fine = 10 ** Math.floor(Math.log10(this.distance / 4));
    context.strokeStyle = color("line");
    for (const [step, width] of [[fine, 0.5], [10 * fine, 1.4]]) {
      const [x, y] = this.target.map((at) => Math.round(at / step) * step);
      const reach = GRID_LINES * step;
      context.lineWidth = width;
      context.beginPath();
      for (let k = -GRID_LINES; k <= GRID_LINES; k++) {
        this.trace(context, [x + k * step, y - reach, 0], [x + k * step, y + reach, 0]);
        this.trace(context, [x - reach, y + k * step, 0], [x + reach, y + k * step, 0]);
      }
      context.stroke();
    }
    context.fillStyle = color("soft");
    context.font = FONT;
    context.fillText(`grid ${fine} m, bold ${10 * fine} m`, 10, height - 10);
  }

  paintLine(context, { x, y }, stroke, width) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    for (let i = 1; i < x.length; i++) {
      if (!Number.isNaN(x[i] + x[i - 1])) this.trace(context, [x[i - 1], y[i - 1], 0], [x[i], y[i], 0]);
    }
    context.stroke();
  }

  paintVehicle(context, drive, place) {
    const [cos, sin] = [Math.cos(place.heading), Math.sin(place.heading)];
    const inWorld = ([x, y, z]) => [place.x + cos * x - sin * y, place.y + sin * x + cos * y, z];
    // From above, what is higher hides what is lower: the boxes are in that order.
    const faces = bodyOf(drive.track).flatMap(({ corners, paint }) =>
      BOX_FACES.map((face) => ({ paint, points: face.map((k) => inWorld(corners[k])) })),
    );
    if (faces.some(({ points }) => points.some((point) => this.depth(point) < SCENE_NEAR))) return;
    for (const { points, paint } of faces) {
      const normal = normalOf(points);
      if (dot(minusOf(points[0], this.eye), normal) >= 0) continue;
      const light = 0.6 + 0.4 * Math.max(0, dot(normal, LIGHT));
      context.fillStyle = context.strokeStyle = shade(paint ?? color(drive.color), light);
      context.lineWidth = 0.7;
      context.beginPath();
      for (const point of points) context.lineTo(...this.project(point));
      context.closePath();
      context.fill();
      context.stroke();
    }
  }

  /** The reference point on a post, and the error line from it to the vehicle. */
  paintReference(context, { x, y, rx, ry }) {
    if (!Number.isFinite(rx + ry) || this.depth([rx, ry, POST_M]) < SCENE_NEAR) return;
    context.strokeStyle = color("error");
    context.lineWidth = 2;
    context.beginPath();
    this.trace(context, [x, y, POST_M], [rx, ry, POST_M]);
    context.stroke();
    context.strokeStyle = context.fillStyle = color("requested");
    context.beginPath();
    this.trace(context, [rx, ry, 0], [rx, ry, POST_M]);
    context.stroke();
    const radius = (0.3 * this.focal) / this.depth([rx, ry, POST_M]);
    context.beginPath();
    context.arc(...this.project([rx, ry, POST_M]), Math.max(radius, 2.5), 0, 2 * Math.PI);
    context.fill();
  }
}

/** Of a box whose corners are bottom and top, each counter-clockwise from the rear right. */
const BOX_FACES = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

function boxOf([back, front], halfWidth, [low, high], top = { back, front, halfWidth }) {
  const ring = (rear, nose, side, z) => [[rear, -side, z], [nose, -side, z], [nose, side, z], [rear, side, z]];
  return [...ring(back, front, halfWidth, low), ...ring(top.back, top.front, top.halfWidth, high)];
}

/** The boxes of a vehicle in its own frame, whose origin is the rear axle on the ground, the lowest first. */
function bodyOf(track) {
  if (track.body) return track.body;
  const { length_m: length, width_m: width, height_m: height, wheelbase_m: base, rear_overhang_m: overhang } = track;
  const at = (share) => share * length - overhang;
  const radius = 0.22 * height;
  const wheel = (x, side) => ({
    paint: "#4d545c",
    corners: boxOf([x - radius, x + radius], 0.1, [0, 2 * radius]).map(([a, b, c]) => [a, b + side * (width / 2 - 0.1), c]),
  });
  track.body = [
    ...[0, base].flatMap((x) => [wheel(x, 1), wheel(x, -1)]),
    { corners: boxOf([at(0), at(1)], width / 2, [0.22 * height, 0.6 * height]) },
    {
      paint: "#33404f",
      corners: boxOf([at(0.06), at(0.74)], 0.46 * width, [0.6 * height, 0.96 * height], {
        back: at(0.16), front: at(0.56), halfWidth: 0.38 * width,
      }),
    },
    { corners: boxOf([at(0.16), at(0.56)], 0.38 * width, [0.96 * height, height]) },
  ];
  return track.body;
}

const minusOf = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function normalOf([a, b, c]) {
  const [u, v] = [minusOf(b, a), minusOf(c, b)];
  const across = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const length = Math.hypot(...across) || 1;
  return across.map((part) => part / length);
}

/** A colour "#rrggbb", darker. */
function shade(paint, light) {
  const channels = [1, 3, 5].map((at) => Math.round(light * parseInt(paint.slice(at, at + 2), 16)));
  return `rgb(${channels.join()})`;
}

/** Points at least `THIN_M` apart, with their gaps. */
function thinOut(xs, ys) {
  const [x, y] = [[], []];
  for (let i = 0; i < xs.length; i++) {
    const isKnown = !Number.isNaN(xs[i] + ys[i]);
    const last = x.length - 1;
    if (isKnown && last >= 0 && Math.hypot(xs[i] - x[last], ys[i] - y[last]) < THIN_M) continue;
    if (!isKnown && (last < 0 || Number.isNaN(x[last]))) continue;
    x.push(isKnown ? xs[i] : NaN);
    y.push(ys[i]);
  }
  return { x, y };
}
