// Builds the page from its data.

/** All rows between the edges of the plots as CSV; an empty cell where nothing is known. */
function windowAsCsv(view) {
  const { drives, plots } = view.page;
  const hasSeveral = drives.length > 1;
  const curves = plots.flatMap((plot) => plot.curves);
  const keys = [...new Set(curves.map((curve) => curve.key))];
  const hasTrack = drives.some((drive) => drive.track);
  const head = [...(hasSeveral ? ["drive"] : []), "time_s", ...(view.page.has_way ? ["way_m"] : []), "state", "reason", ...(hasTrack ? ["x_m", "y_m", "heading_rad"] : []), ...keys];
  const lines = [head.join(",")];
  drives.forEach((drive, number) => {
    const axis = view.axisOf(drive);
    const columns = keys.map((key) => curves.find((curve) => curve.drive === number && curve.key === key));
    const cell = (values, row, decimals) => (values && Number.isFinite(values[row]) ? values[row].toFixed(decimals) : "");
    const begins = drive.states.map(([at]) => at);
    for (let row = Math.max(0, lastAt(axis, view.from - 1e-9) + 1); row < axis.length && axis[row] <= view.to + 1e-9; row++) {
      const [, state = "", reason = ""] = drive.states[lastAt(begins, drive.time[row] + 1e-9)] ?? [];
      const { track } = drive;
      const place = hasTrack ? ["x", "y", "heading"].map((name) => (track ? cell(track[name], row, track[`${name}Decimals`]) : "")) : [];
      const cells = columns.map((curve) => (curve ? cell(curve.values, row, curve.valuesDecimals) : ""));
      lines.push([...(hasSeveral ? [drive.label.replaceAll(/[",\n]/g, " ")] : []), cell(drive.time, row, drive.timeDecimals), ...(view.page.has_way ? [cell(drive.way, row, drive.wayDecimals)] : []), state, reason, ...place, ...cells].join(","));
    }
  });
  return lines.join("\n") + "\n";
}

/** What is true at the cursor, in words, of one drive. */
function nowLine(drive, view) {
  const box = element("div", { class: "now", "data-drive": drive.label });
  const begins = drive.states.map(([at]) => at);
  const move = () => {
    const row = view.placeOf(drive);
    const [, state, reason, mode, gear] = (row >= 0 && drive.states[lastAt(begins, drive.time[row] + 1e-9)]) || [];
    const parts = view.page.drives.length > 1 ? [element("span", {}, element("i", { class: "swatch", style: `background: var(--${drive.color})` }), element("b", {}, drive.label))] : [];
    if (row >= 0 && view.axis === "way") parts.push(element("span", {}, `at ${figure(drive.time[row], 2)} s`));
    if (state) {
      parts.push(element("span", {}, element("i", { class: "swatch", style: `background: var(--${state})` }), element("b", {}, state)), element("span", {}, "reason ", element("b", {}, reason)));
      if (mode) parts.push(element("span", {}, "vehicle ", element("b", {}, mode)), element("span", {}, "gear ", element("b", {}, gear)));
    } else parts.push(element("span", { class: "quiet" }, row < 0 ? "not recorded here" : "nothing known"));
    if (row >= 0 && drive.track && Number.isFinite(drive.track.x[row])) parts.push(element("span", { class: "quiet" }, `x ${figure(drive.track.x[row], 2)} m · y ${figure(drive.track.y[row], 2)} m`));
    box.replaceChildren(...parts);
  };
  return { box, move };
}

loadPage().then((page) => {
  const find = (name) => document.getElementById(name);
  const view = new View(page);
  const player = new Player(view);
  const plots = page.plots.map((plot) => new Plot(plot, view, selectWith));
  const strips = page.drives.filter((drive) => drive.states.length || drive.ticks.length).map((drive) => new Strip(drive, view));
  const lines = page.drives.filter((drive) => drive.states.length).map((drive) => nowLine(drive, view));
  const lists = page.drives.filter((drive) => drive.events.length || page.drives.length === 1).map((drive) => new EventList(drive, view));
  const map = new PathMap(find("map"), view);
  const clock = find("clock");
  find("plots").append(...plots.map((plot) => plot.figure));
  find("strips").append(...strips.map((strip) => strip.box), stripLegend(page.drives));
  find("now").append(...lines.map((line) => line.box));
  find("events").append(...lists.map((list) => list.box));
  find("events").classList.toggle("pair", lists.length > 1);
  find("axis").hidden = !page.has_way;

  const drawAll = () => {
    for (const part of [...plots, ...strips, map]) part.draw();
    moveAll();
  };
  const moveAll = () => {
    for (const part of [...plots, ...strips, ...lines, ...lists]) part.move();
    map.draw();
    clock.textContent = `${figure(view.cursor, 2)} / ${figure(view.high, 1)} ${view.unit}`;
  };
  let due = "";
  const schedule = (what) => {
    if (!due) requestAnimationFrame(() => ((due === "window" ? drawAll : moveAll)(), (due = "")));
    if (due !== "window") due = what;
  };
  view.listen(schedule);

  const word = page.drives.some((drive) => drive.events.some(isStop)) ? "Stop" : "Event";
  find("previous").textContent = `◀ ${word}`;
  find("next").textContent = `${word} ▶`;
  find("plots").style.setProperty("--plots", plots.length);
  find("previous").addEventListener("click", () => player.seekStop(-1));
  find("next").addEventListener("click", () => player.seekStop(1));
  find("whole").addEventListener("click", () => view.setWindow(view.low, view.high));
  find("fit").addEventListener("change", (event) => view.setFit(event.target.checked));
  find("axis").addEventListener("change", (event) => view.setAxis(event.target.value));
  find("csv").addEventListener("click", () => saveBlob(new Blob([windowAsCsv(view)], { type: "text/csv" }), `${page.name}-window.csv`));
  listenToKeys(view, player);
  new ResizeObserver(() => schedule("window")).observe(find("plots"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => schedule("window"));
  const print = (isPrinting) => {
    document.documentElement.classList.toggle("printing", isPrinting);
    drawAll();
  };
  matchMedia("print").addEventListener("change", (event) => print(event.matches));
  addEventListener("beforeprint", () => print(true));
  addEventListener("afterprint", () => print(false));
  drawAll();
  document.body.dataset.ready = "true";
});
