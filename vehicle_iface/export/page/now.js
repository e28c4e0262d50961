// What is true at the cursor, in words.

/** State, reason, mode and gear of a drive in a row; empty where they are unknown. */
function stateAt(drive, row) {
  const begins = (drive.begins ??= drive.states.map(([at]) => at));
  const [, state = "", reason = "", mode = "", gear = ""] =
    (row >= 0 && drive.states[lastAt(begins, drive.time[row] + 1e-9)]) || [];
  return { state, reason, mode, gear };
}

const swatch = (name) => element("i", { class: "swatch", style: `background: var(--${name})` });

class NowLine {
  constructor(drive, view) {
    this.drive = drive;
    this.view = view;
    this.box = element("div", { class: "now" });
  }

  move() {
    const { drive, view } = this;
    const row = view.placeOf(drive);
    const { state, reason, mode, gear } = stateAt(drive, row);
    const parts = [];
    const add = (...children) => parts.push(element("span", {}, ...children));
    const bold = (text) => element("b", {}, text);
    if (view.page.drives.length > 1) add(swatch(drive.color), bold(drive.label));
    if (row >= 0 && view.axis === "way") add(`at ${figure(drive.time[row], 2)} s`);
    if (state) {
      add(swatch(state), bold(state));
      add("reason ", bold(reason));
    } else add(row < 0 ? "not recorded here" : "nothing known");
    if (mode) {
      add("vehicle ", bold(mode));
      add("gear ", bold(gear));
    }
    const { x, y } = drive.track ?? {};
    if (row >= 0 && x && Number.isFinite(x[row])) add(`x ${figure(x[row], 2)} m · y ${figure(y[row], 2)} m`);
    this.box.replaceChildren(...parts);
  }
}
