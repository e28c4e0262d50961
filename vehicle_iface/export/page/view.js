// What all parts of the page show: the horizontal axis, its window, the cursor.

class View {
  constructor(page) {
    this.page = page;
    this.listeners = [];
    this.fit = false;
    this.setAxis("time");
  }

  /** `kind` is "time" (s) or "way" (m). The cursor stays at the same moment of the first drive that has come so far. */
  setAxis(kind) {
    const places = this.axis ? this.page.drives.map((drive) => this.placeOf(drive)) : [];
    this.axis = kind;
    this.unit = kind === "way" ? "m" : "s";
    const ends = this.page.drives.map((drive) => this.axisOf(drive)).filter((axis) => axis.length);
    this.low = Math.min(...ends.map((axis) => axis[0]));
    this.high = Math.max(...ends.map((axis) => axis[axis.length - 1]), this.low + 1e-3);
    const known = places.findIndex((place) => place >= 0);
    this.cursor = known < 0 ? this.low : this.axisOf(this.page.drives[known])[places[known]];
    this.from = this.low;
    this.to = this.high;
    this.notify("window");
  }

  axisOf(drive) {
    return this.axis === "way" ? drive.way : drive.time;
  }

  /** Where on the axis a time of a drive is. */
  place(drive, time) {
    if (this.axis === "time") return time;
    return drive.way[Math.max(0, lastAt(drive.time, time))];
  }

  /** The drive's row at the cursor; −1 before its beginning and after its end. */
  placeOf(drive) {
    const axis = this.axisOf(drive);
    if (!axis.length || this.cursor > axis[axis.length - 1] + 1e-6) return -1;
    return lastAt(axis, this.cursor + 1e-9);
  }

  setCursor(at) {
    this.cursor = Math.min(Math.max(at, this.low), this.high);
    if (this.cursor < this.from || this.cursor > this.to) {
      const span = this.to - this.from;
      const from = this.cursor - (this.cursor > this.to ? 0.1 : 0.9) * span;
      this.setWindow(from, from + span);
    }
    this.notify("cursor");
  }

  setWindow(from, to) {
    const span = Math.min(Math.max(to - from, 0.02), this.high - this.low);
    this.from = Math.min(Math.max((from + to - span) / 2, this.low), this.high - span);
    this.to = this.from + span;
    this.notify("window");
  }

  setFit(fit) {
    this.fit = fit;
    this.notify("window");
  }

  /** Calls `listener` with "window" when everything is to be drawn, and with "cursor" when only the cursor moved. */
  listen(listener) {
    this.listeners.push(listener);
  }

  notify(what) {
    for (const listener of this.listeners) listener(what);
  }
}
