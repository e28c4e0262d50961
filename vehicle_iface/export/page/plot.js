// One plot: curves of one unit on a canvas. Of many values in a column of pixels the extremes are drawn.

const GUTTER = 54;
const FOOT = 20;
const FONT = "12px system-ui, 'Segoe UI', Roboto, 'Noto Sans', 'Liberation Sans', Arial, sans-serif";

function roundTicks(low, high, most) {
  const rough = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= rough * (1 - 1e-9));
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(0, count) }, (_, place) => {
    const at = (first + place) * step;
    return { at, text: figure(at, digits) };
  });
}

/** Calls `move` at the beginning of each piece and `line` for its other points, in pixels. */
function traceCurve(axis, values, { from, to, toX, toY }, move, line) {
  const first = Math.max(0, lastAt(axis, from) - 1);
  const last = Math.min(axis.length - 1, lastAt(axis, to) + 1);
  let isDrawn = false;
  let column = NaN;
  let low = NaN;
  let high = NaN;
  let end = NaN;
  const flush = () => {
    if (Number.isNaN(column)) return;
    if (low !== high) {
      line(column, toY(low));
      line(column, toY(high));
    }
    if (end !== high) line(column, toY(end));
    column = NaN;
  };
  for (let i = first; i <= last; i++) {
    const value = values[i];
    if (Number.isNaN(value)) {
      flush();
      isDrawn = false;
      continue;
    }
    const pixel = Math.round(2 * toX(axis[i])) / 2;
    if (pixel !== column) {
      flush();
      if (isDrawn) line(pixel, toY(value));
      else move(pixel, toY(value));
      isDrawn = true;
      column = pixel;
      low = high = end = value;
    } else {
      low = Math.min(low, value);
      high = Math.max(high, value);
      end = value;
    }
  }
  flush();
}

class Plot {
  constructor(plot, view, select) {
    this.plot = plot;
    this.view = view;
    this.outputs = plot.curves.map((curve) => element("output", { "data-curve": curve.key, "data-drive": curve.drive }));
    this.canvas = element("canvas", { role: "img", "aria-label": `${plot.title}, ${plot.unit}` });
    this.cursor = element("i", { class: "cursor" });
    const save = element("button", { type: "button", class: "save", title: "Save this plot as a picture" }, "save PNG");
    save.addEventListener("click", () => this.save());
    this.swatches = plot.curves.map(() => element("i"));
    const values = plot.curves.map((curve, place) => {
      return element("span", { class: "value" }, this.swatches[place], `${curve.label} `, this.outputs[place]);
    });
    const heading = [element("b", {}, plot.title), element("span", { class: "quiet" }, plot.unit)];
    const caption = element("figcaption", {}, ...heading, ...values, save);
    this.field = element("div", { class: "field" }, this.canvas, this.cursor);
    this.figure = element("figure", { class: "plot" }, caption, this.field);
    select(this.field, view);
  }

  /** Range of the vertical axis: that of the limits, larger where values are, or that of the visible values. */
  range() {
    const { plot, view } = this;
    let low = Infinity;
    let high = -Infinity;
    for (const curve of plot.curves) {
      const axis = view.axisOf(view.page.drives[curve.drive]);
      const last = lastAt(axis, view.to);
      for (let i = Math.max(0, lastAt(axis, view.from)); i <= last; i++) {
        if (curve.values[i] < low) low = curve.values[i];
        if (curve.values[i] > high) high = curve.values[i];
      }
    }
    if (!view.fit && plot.low !== null) {
      low = Math.min(low, plot.low);
      high = Math.max(high, plot.high);
    }
    if (low > high) return [plot.low ?? 0, plot.high ?? 1];
    const margin = 0.06 * (high - low) || Math.max(0.1 * Math.abs(high), 10 ** -plot.digits);
    return [low - margin, high + margin];
  }

  draw() {
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    this.paint(context, width, height);
    this.swatches.forEach((swatch, place) => (swatch.style.borderColor = color(this.plot.curves[place].color)));
    this.move();
  }

  paint(context, width, height) {
    const { plot, view } = this;
    const [low, high] = this.range();
    const bottom = height - FOOT;
    const toX = (at) => GUTTER + ((at - view.from) / (view.to - view.from)) * (width - GUTTER);
    const toY = (value) => 4 + ((high - value) / (high - low)) * (bottom - 8);
    context.font = FONT;
    context.lineWidth = 1;
    context.strokeStyle = color("grid");
    context.fillStyle = color("soft");
    context.textBaseline = "middle";
    context.textAlign = "right";
    const stroke = (path) => {
      context.beginPath();
      path();
      context.stroke();
    };
    for (const { at, text } of roundTicks(low, high, 6)) {
      const y = Math.round(toY(at)) + 0.5;
      stroke(() => (context.moveTo(GUTTER, y), context.lineTo(width, y)));
      context.fillText(text, GUTTER - 6, y);
    }
    context.textAlign = "center";
    for (const { at, text } of roundTicks(view.from, view.to, Math.max(3, width / 110))) {
      const x = Math.round(toX(at)) + 0.5;
      stroke(() => (context.moveTo(x, 0), context.lineTo(x, bottom)));
      if (x > GUTTER + 14 && x < width - 18) context.fillText(`${text} ${view.unit}`, x, height - FOOT / 2 + 2);
    }
    context.save();
    context.beginPath();
    context.rect(GUTTER, 0, width - GUTTER, bottom);
    context.clip();
    context.strokeStyle = color("limit");
    context.setLineDash([6, 4]);
    for (const limit of plot.limits) {
      stroke(() => (context.moveTo(GUTTER, toY(limit)), context.lineTo(width, toY(limit))));
    }
    context.setLineDash([]);
    context.lineJoin = "round";
    for (const curve of plot.curves) {
      const axis = view.axisOf(view.page.drives[curve.drive]);
      context.strokeStyle = color(curve.color);
      context.lineWidth = curve.width;
      let before = 0;
      const move = (x, y) => {
        context.moveTo(x, y);
        context.lineTo(x + 0.01, y); // a single value is a dot
        before = y;
      };
      const line = (x, y) => {
        if (curve.is_stepped) context.lineTo(x, before);
        before = y;
        context.lineTo(x, y);
      };
      stroke(() => traceCurve(axis, curve.values, { from: view.from, to: view.to, toX, toY }, move, line));
    }
    context.restore();
    context.strokeStyle = color("line");
    context.strokeRect(GUTTER + 0.5, 0.5, width - GUTTER - 1, bottom - 1);
  }

  /** The cursor and the values there. */
  move() {
    const { view } = this;
    const width = this.field.clientWidth;
    const share = (view.cursor - view.from) / (view.to - view.from);
    this.cursor.style.transform = `translateX(${GUTTER + share * (width - GUTTER)}px)`;
    this.plot.curves.forEach((curve, place) => {
      const row = view.placeOf(view.page.drives[curve.drive]);
      this.outputs[place].textContent = row < 0 ? "–" : figure(curve.values[row], this.plot.digits);
    });
  }

  /** Saves the plot as it is, with title and legend, at twice the size. */
  save() {
    const { plot, view } = this;
    const [width, height, head] = [Math.max(700, this.canvas.clientWidth), Math.max(260, this.canvas.clientHeight), 44];
    const canvas = element("canvas");
    canvas.width = 2 * width;
    canvas.height = 2 * (height + head);
    const context = canvas.getContext("2d");
    context.scale(2, 2);
    context.fillStyle = color("ground");
    context.fillRect(0, 0, width, height + head);
    context.fillStyle = color("ink");
    context.font = `600 14px ${FONT.slice(5)}`;
    context.fillText(`${plot.title}, ${plot.unit}`, GUTTER, 17);
    context.font = FONT;
    let x = GUTTER;
    for (const curve of plot.curves) {
      context.fillStyle = color(curve.color);
      context.fillRect(x, 30, 18, 3);
      context.fillStyle = color("soft");
      context.fillText(curve.label, x + 23, 35);
      x += 40 + context.measureText(curve.label).width;
    }
    context.translate(0, head);
    this.paint(context, width, height);
    const name = plot.title.toLowerCase().replaceAll(" ", "-");
    canvas.toBlob((blob) => saveBlob(blob, `${view.page.name}-${name}.png`), "image/png");
  }
}
