// Plays: moves the cursor on with time. By way, the whole way takes as long as the longest drive.

class Player {
  constructor(view) {
    this.view = view;
    this.button = document.getElementById("play");
    this.speed = document.getElementById("speed");
    this.button.addEventListener("click", () => this.toggle());
  }

  /** Units of the axis in a second of real time. */
  rate() {
    const { view } = this;
    if (view.axis === "time") return Number(this.speed.value);
    const longest = Math.max(...view.page.drives.map(({ time }) => time[time.length - 1] - time[0]));
    return (Number(this.speed.value) * (view.high - view.low)) / longest;
  }

  toggle(isPlaying = !this.view.isPlaying) {
    const { view } = this;
    if (isPlaying && view.cursor >= view.high) view.setCursor(view.low);
    view.isPlaying = isPlaying;
    this.button.textContent = isPlaying ? "⏸ Pause" : "▶ Play";
    this.shown = null;
    if (isPlaying) requestAnimationFrame((now) => this.advance(now));
  }

  advance(now) {
    const { view } = this;
    if (!view.isPlaying) return;
    if (this.shown !== null) view.setCursor(view.cursor + ((now - this.shown) / 1000) * this.rate());
    this.shown = now;
    if (view.cursor >= view.high) this.toggle(false);
    else requestAnimationFrame((next) => this.advance(next));
  }

  /** Goes to the next stop (1) or to the one before (−1); without stops to the next event. */
  seekStop(step) {
    const { view } = this;
    const placed = (drive) => drive.events.map((event) => ({ event, at: view.place(drive, event.at_s) }));
    const all = view.page.drives.flatMap(placed);
    const stops = all.filter(({ event }) => isStop(event));
    const places = (stops.length ? stops : all).map(({ at }) => at).sort((a, b) => a - b);
    const found = step > 0 ? places.find((at) => at > view.cursor + 1e-3) : places.findLast((at) => at < view.cursor - 1e-3);
    if (found !== undefined) view.setCursor(found);
  }
}

/** Keys: space, arrows. */
function listenToKeys(view, player) {
  document.addEventListener("keydown", (event) => {
    if (event.target.closest?.("select, input") || event.ctrlKey || event.altKey || event.metaKey) return;
    const step = (event.shiftKey ? 1 : 0.1) * (view.axis === "way" ? 10 : 1);
    const actions = {
      " ": () => player.toggle(),
      ArrowLeft: () => view.setCursor(view.cursor - step),
      ArrowRight: () => view.setCursor(view.cursor + step),
      ArrowUp: () => player.seekStop(-1),
      ArrowDown: () => player.seekStop(1),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    if (event.target.blur && event.target !== document.body) event.target.blur();
    action();
  });
}
