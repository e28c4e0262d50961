// The strip of states of one drive, over its whole length; a click goes there.

class Strip {
  constructor(drive, view) {
    this.drive = drive;
    this.view = view;
    this.canvas = element("canvas", { role: "img", "aria-label": `States of ${drive.label}` });
    this.cursor = element("i", { class: "cursor" });
    this.box = element("div", { class: "strip" }, this.canvas, this.cursor);
    this.canvas.addEventListener("pointerdown", (event) => {
      const { left, width } = this.canvas.getBoundingClientRect();
      view.setCursor(view.low + ((event.clientX - left) / width) * (view.high - view.low));
    });
  }

  draw() {
    const { drive, view } = this;
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    const toX = (at) => ((at - view.low) / (view.high - view.low)) * width;
    const axis = view.axisOf(drive);
    const end = axis.length ? toX(axis[axis.length - 1]) : 0;
    context.fillStyle = color("raised");
    context.fillRect(0, 0, width, height);
    drive.states.forEach(([at, state], place) => {
      const next = drive.states[place + 1];
      const left = toX(view.place(drive, at));
      const right = next ? toX(view.place(drive, next[0])) : end;
      if (!state) return;
      context.fillStyle = color(state);
      context.fillRect(left, 8, Math.max(right - left, 1), height - 8);
    });
    for (const { color: name, at_s } of drive.ticks) {
      context.fillStyle = color(name);
      for (const at of at_s) context.fillRect(toX(view.place(drive, at)), 0, 1.5, 7);
    }
    context.strokeStyle = color("ink");
    context.lineWidth = 1.5;
    const [left, right] = [toX(view.from), toX(view.to)];
    if (right - left < width - 1) context.strokeRect(left, 8.5, Math.max(right - left, 2), height - 9.5);
    this.move();
  }

  move() {
    const share = (this.view.cursor - this.view.low) / (this.view.high - this.view.low);
    this.cursor.style.transform = `translateX(${share * this.box.clientWidth - 1}px)`;
  }
}

/** The colours of the states and ticks that the drives have. */
function stripLegend(drives) {
  const states = new Set(drives.flatMap((drive) => drive.states.map(([, state]) => state)).filter(Boolean));
  const seen = drives.flatMap((drive) => drive.ticks.filter((one) => one.at_s.length));
  const ticks = new Map(seen.map((one) => [one.label, one.color]));
  const named = [...ticks].map(([label, name]) => [`| ${label}`, name]);
  const entries = [...[...states].map((state) => [state, state]), ...named];
  const items = entries.map(([label, name]) => {
    return element("span", {}, swatch(name), label);
  });
  return element("div", { class: "strip-legend" }, ...items);
}
