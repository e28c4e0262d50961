// Builds the page from its data.

loadPage().then((page) => {
  const find = (name) => document.getElementById(name);
  const view = new View(page);
  const player = new Player(view);
  const plots = page.plots.map((plot) => new Plot(plot, view, selectWith));
  const withStrip = page.drives.filter((drive) => drive.states.length || drive.ticks.length);
  const strips = withStrip.map((drive) => new Strip(drive, view));
  const lines = page.drives.filter((drive) => drive.states.length).map((drive) => new NowLine(drive, view));
  const withEvents = page.drives.filter((drive) => drive.events.length || page.drives.length === 1);
  const lists = withEvents.map((drive) => new EventList(drive, view));
  const map = new PathMap(find("map"), view);
  const scene = new Scene(find("scene"), view, map.bounds);
  const clock = find("clock");
  find("plots").append(...plots.map((plot) => plot.figure));
  find("strips").append(...strips.map((strip) => strip.box), stripLegend(page.drives));
  find("now").append(...lines.map((line) => line.box));
  find("events").append(...lists.map((list) => list.box));
  find("events").classList.toggle("pair", lists.length > 1);
  find("axis").hidden = !page.has_way;

  const drawAll = () => {
    for (const part of [...plots, ...strips]) part.draw();
    moveAll();
  };
  const moveAll = () => {
    for (const part of [...plots, ...strips, ...lines, ...lists]) part.move();
    map.draw();
    scene.draw();
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
  find("csv").addEventListener("click", () => {
    saveBlob(new Blob([windowAsCsv(view)], { type: "text/csv" }), `${page.name}-window.csv`);
  });
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
