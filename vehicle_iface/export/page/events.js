// The events of one drive. A click goes to one; the last one before the cursor is marked.

const isStop = (event) => event.kind === "stop" && event.phase !== "ended";

class EventList {
  constructor(drive, view) {
    this.drive = drive;
    this.view = view;
    this.items = drive.events.map((event) => {
      const name = element("b", {}, `${event.kind} ${event.name}`);
      const words = element("span", {}, name, ` ${event.phase} `, element("span", {}, event.text));
      const time = element("time", {}, `${figure(event.at_s, 3)} s`);
      const button = element("button", { type: "button", class: event.kind }, time, words);
      button.addEventListener("click", () => view.setCursor(view.place(drive, event.at_s)));
      return element("li", {}, button);
    });
    this.list = element("ol", { class: "events" }, ...this.items);
    const notes = [];
    if (view.page.has_way) notes.push(drive.label);
    if (!drive.events.length) notes.push("no event");
    if (drive.events_left_out) notes.push(`${drive.events_left_out} more are left out: export a shorter part`);
    this.times = drive.events.map((event) => event.at_s);
    this.box = element("div", {}, element("p", { class: "quiet" }, notes.join(" · ")), this.list);
    this.current = -1;
  }

  move() {
    const row = this.view.placeOf(this.drive);
    const time = this.view.axis === "time" ? this.view.cursor : row < 0 ? -Infinity : this.drive.time[row];
    const current = lastAt(this.times, time + 1e-6);
    if (current === this.current) return;
    this.items[this.current]?.removeAttribute("aria-current");
    this.current = current;
    const item = this.items[current];
    if (!item) return;
    item.setAttribute("aria-current", "true");
    const above = item.offsetTop - this.list.offsetTop;
    const below = above + item.offsetHeight;
    if (above < this.list.scrollTop) this.list.scrollTop = above;
    else if (below > this.list.scrollTop + this.list.clientHeight) this.list.scrollTop = below - this.list.clientHeight;
  }
}
