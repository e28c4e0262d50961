// Pointer on a plot: the cursor, and the window of time.

/** Pointer on a plot or its like: move for the cursor, drag to zoom, wheel with Shift or Ctrl. */
function selectWith(field, view) {
  const drag = element("i", { class: "drag", hidden: "" });
  field.append(drag);
  let begun = null;
  const at = (event) => {
    const box = field.getBoundingClientRect();
    const share = (event.clientX - box.left - GUTTER) / (box.width - GUTTER);
    return view.from + Math.min(Math.max(share, 0), 1) * (view.to - view.from);
  };
  const toPixel = (value) => GUTTER + ((value - view.from) / (view.to - view.from)) * (field.clientWidth - GUTTER);
  const isDrag = (event) => begun && Math.abs(event.clientX - begun.x) > 5;
  field.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    begun = { x: event.clientX, at: at(event) };
    if (event.pointerType !== "touch") field.setPointerCapture(event.pointerId);
  });
  field.addEventListener("pointermove", (event) => {
    if (isDrag(event)) {
      const [left, right] = [begun.at, at(event)].sort((a, b) => a - b).map(toPixel);
      drag.hidden = false;
      drag.style.transform = `translateX(${left}px)`;
      drag.style.width = `${right - left}px`;
    } else if (!view.isPlaying) view.setCursor(at(event));
  });
  field.addEventListener("pointerup", (event) => {
    if (isDrag(event)) view.setWindow(...[begun.at, at(event)].sort((a, b) => a - b));
    else if (begun) view.setCursor(at(event));
    begun = null;
    drag.hidden = true;
  });
  field.addEventListener("pointercancel", () => ((begun = null), (drag.hidden = true)));
  field.addEventListener("dblclick", () => view.setWindow(view.low, view.high));
  field.addEventListener(
    "wheel",
    (event) => {
      const span = view.to - view.from;
      if (event.ctrlKey) {
        const center = at(event);
        const factor = Math.exp(0.002 * event.deltaY);
        view.setWindow(center - (center - view.from) * factor, center + (view.to - center) * factor);
      } else if (event.shiftKey || event.deltaX) {
        const step = (0.001 * (event.deltaX || event.deltaY)) * span;
        view.setWindow(view.from + step, view.to + step);
      } else return;
      event.preventDefault();
    },
    { passive: false },
  );
}
