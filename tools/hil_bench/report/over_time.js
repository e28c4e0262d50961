"use strict";
(() => {
  const LEAST_S = 0.02;
  const AROUND_S = 0.5;
  const CLICK_PX = 4;

  /** Points of a path that was written as M x y l dx dy dx dy …: pieces of [x, y] with rising x. */
  function piecesOf(path) {
    return path
      .getAttribute("d")
      .split("M")
      .filter(Boolean)
      .map((text) => {
        const numbers = text.split(/[l ]/).map(Number);
        let [x, y] = numbers;
        const points = [[x, y]];
        for (let i = 2; i + 1 < numbers.length; i += 2) points.push([(x += numbers[i]), (y += numbers[i + 1])]);
        return points;
      });
  }

  function heightAt(pieces, x) {
    for (const points of pieces) {
      if (x < points[0][0] || x > points[points.length - 1][0]) continue;
      const next = points.findIndex((point) => point[0] >= x);
      if (next === 0) return points[0][1];
      const [[x0, y0], [x1, y1]] = [points[next - 1], points[next]];
      return x1 === x0 ? y1 : y0 + ((y1 - y0) * (x - x0)) / (x1 - x0);
    }
    return null;
  }

  const shown = (value) => String(Number(value.toPrecision(3))).replace("-", "−");

  function since(seconds) {
    const size = Math.abs(seconds);
    return (seconds < 0 ? "−" : "+") + (size < 1 ? `${(size * 1e3).toFixed(0)} ms` : `${size.toFixed(2)} s`);
  }

  function roundStep(rough) {
    const power = 10 ** Math.floor(Math.log10(rough));
    return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= rough * (1 - 1e-9));
  }

  class OverTime {
    constructor(figure) {
      this.figure = figure;
      this.low = Number(figure.dataset.low);
      this.high = Number(figure.dataset.high);
      this.zero = Number(figure.dataset.zero);
      this.from = this.low;
      this.to = this.high;
      const find = (selector) => [...figure.querySelectorAll(selector)];
      this.fields = find("svg.time");
      const { width, height } = this.fields[0]?.viewBox.baseVal ?? { width: 1, height: 1 };
      this.units = { width, height };
      this.ribbons = find(".ribbon");
      this.dots = find(".dot");
      this.leaders = find(".leader");
      this.ticks = figure.querySelector(".ticks");
      this.over = figure.querySelector(".overlay");
      this.body = figure.querySelector(".body");
      [this.cursor, this.chosen, this.now] = [".cursor", ".chosen", ".now"].map((name) => figure.querySelector(name));
      this.whole = figure.querySelector("button[name=whole]");
      this.curves = null;
      this.begun = null;
      figure.classList.add("live");
      this.listen(find("ol li"));
    }

    listen(events) {
      this.whole.addEventListener("click", () => this.show(this.low, this.high));
      for (const item of events) {
        const at = this.low + Number(item.dataset.share) * (this.high - this.low);
        item.addEventListener("click", () => this.show(at - AROUND_S, at + AROUND_S));
      }
      this.body.addEventListener("pointermove", (event) => this.point(event));
      this.body.addEventListener("pointerleave", () => this.leave());
      this.body.addEventListener("pointerdown", (event) => {
        if (event.button === 0 && event.pointerType !== "touch") this.begun = this.place(event);
      });
      this.body.addEventListener("pointerup", (event) => this.release(event));
      this.body.addEventListener("dblclick", () => this.show(this.low, this.high));
      this.body.addEventListener("wheel", (event) => this.roll(event), { passive: false });
    }

    /** Pixels from the left edge of the plots, and the time there. */
    place(event) {
      const box = this.over.getBoundingClientRect();
      const px = Math.min(Math.max(event.clientX - box.left, 0), box.width);
      return { px, at: this.from + (px / box.width) * (this.to - this.from) };
    }

    show(from, to) {
      const span = Math.min(Math.max(to - from, LEAST_S), this.high - this.low);
      this.from = Math.min(Math.max((from + to - span) / 2, this.low), this.high - span);
      this.to = this.from + span;
      const whole = this.high - this.low;
      const share = (at) => (at - this.from) / span;
      const inside = (element) => {
        const at = share(this.low + Number(element.dataset.share) * whole);
        element.style.visibility = at < -1e-6 || at > 1 + 1e-6 ? "hidden" : "";
        return at;
      };
      for (const field of this.fields) {
        const left = ((this.from - this.low) / whole) * this.units.width;
        field.setAttribute("viewBox", `${left} 0 ${(span / whole) * this.units.width} ${this.units.height}`);
      }
      for (const ribbon of this.ribbons) {
        ribbon.style.left = `${100 * share(this.low)}%`;
        ribbon.style.width = `${(100 * whole) / span}%`;
      }
      for (const dot of this.dots) dot.style.left = `${100 * inside(dot)}%`;
      for (const leader of this.leaders) {
        const at = inside(leader);
        leader.setAttribute("d", `M${1000 * at} 12L${1000 * Number(leader.dataset.column)} 60`);
      }
      this.writeTicks(share);
      this.whole.disabled = span >= whole;
      this.leave();
    }

    writeTicks(share) {
      const step = roundStep((this.to - this.from) / 8);
      const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
      const first = Math.ceil(this.from / step - 1e-9);
      const count = Math.floor(this.to / step + 1e-9) - first + 1;
      const times = Array.from({ length: count }, (_, place) => (first + place) * step);
      const ticks = times.map((at) => {
        const tick = document.createElement("span");
        tick.className = "x";
        tick.style.left = `${100 * share(at)}%`;
        tick.textContent = `${at.toFixed(digits).replace("-", "−")} s`;
        return tick;
      });
      this.ticks.replaceChildren(...ticks);
      const x = (at) => ((at - this.low) / (this.high - this.low)) * this.units.width;
      const lines = times.map((at) => `M${x(at)} 0v${this.units.height}`).join("");
      for (const field of this.fields) field.querySelector(".upright").setAttribute("d", lines || "M0 0");
    }

    point(event) {
      const { px, at } = this.place(event);
      const width = this.over.clientWidth;
      this.figure.classList.add("pointed");
      this.cursor.hidden = this.now.hidden = false;
      this.cursor.style.left = `${px}px`;
      this.now.textContent = `${at.toFixed(3).replace("-", "−")} s (${since(at - this.zero)})`;
      this.now.style.left = `${Math.min(Math.max(px - this.now.offsetWidth / 2, 0), width - this.now.offsetWidth)}px`;
      this.writeValues(at);
      this.chosen.hidden = !this.begun || Math.abs(px - this.begun.px) < CLICK_PX;
      if (!this.chosen.hidden) {
        this.chosen.style.left = `${Math.min(px, this.begun.px)}px`;
        this.chosen.style.width = `${Math.abs(px - this.begun.px)}px`;
      }
    }

    writeValues(at) {
      this.curves ??= this.fields.map((field) => [...field.querySelectorAll(".curve")].map(piecesOf));
      this.fields.forEach((field, place) => {
        const [low, high] = [Number(field.dataset.low), Number(field.dataset.high)];
        const outputs = field.closest(".row").querySelectorAll("output");
        this.curves[place].forEach((pieces, number) => {
          const height = heightAt(pieces, ((at - this.low) / (this.high - this.low)) * this.units.width);
          outputs[number].textContent = height === null ? "–" : shown(high - (height / this.units.height) * (high - low));
        });
      });
    }

    release(event) {
      const begun = this.begun;
      this.begun = null;
      const { px, at } = this.place(event);
      this.chosen.hidden = true;
      if (begun && Math.abs(px - begun.px) >= CLICK_PX) this.show(Math.min(at, begun.at), Math.max(at, begun.at));
    }

    roll(event) {
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      const { at } = this.place(event);
      const factor = (event.deltaY || event.deltaX) > 0 ? 1.25 : 0.8;
      const around = (end) => at + (end - at) * factor;
      this.show(Math.max(around(this.from), this.low), Math.min(around(this.to), this.high));
    }

    leave() {
      this.figure.classList.remove("pointed");
      this.cursor.hidden = this.chosen.hidden = this.now.hidden = true;
      this.begun = null;
    }
  }

  for (const figure of document.querySelectorAll(".over-time")) new OverTime(figure);
})();
