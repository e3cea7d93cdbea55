// A canvas that fills its box at the screen's resolution, and the gestures on it: drag, wheel, pinch, click.

/** Fit the canvas to its box. Returns {width, height, ratio, changed} in CSS pixels. */
export function fit(canvas) {
  const ratio = Math.min(3, window.devicePixelRatio || 1);
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  const changed = canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio);
  if (changed) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  return { width, height, ratio, changed };
}

const CLICK_PX = 5; // a pointer that moves less than this clicks

/**
 * Listen for gestures on `canvas`. `on` has any of: drag(dx, dy, x, y, event), begin(x, y, event), end(x, y, event),
 * zoom(factor, x, y, event), click(x, y, event), hover(x, y) and leave(). Places are CSS pixels in the canvas.
 */
export function gestures(canvas, on) {
  const down = new Map();
  let moved = 0;
  let pinched = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, place(event));
    if (down.size === 1) {
      moved = 0;
      on.begin?.(...place(event), event);
    } else pinched = span(down);
  });
  canvas.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    const from = down.get(event.pointerId);
    if (!from) {
      on.hover?.(x, y);
      return;
    }
    down.set(event.pointerId, [x, y]);
    moved += Math.hypot(x - from[0], y - from[1]);
    if (down.size === 2) {
      const [a, b] = [...down.values()];
      const now = span(down);
      if (pinched > 0 && now > 0) on.zoom?.(now / pinched, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2, event);
      pinched = now;
    } else if (moved > CLICK_PX) on.drag?.(x - from[0], y - from[1], x, y, event);
  });
  const up = (event) => {
    if (!down.delete(event.pointerId)) return;
    if (down.size) moved = Infinity; // the end of a pinch is no click
    else {
      if (event.type === "pointerup" && moved <= CLICK_PX) on.click?.(...place(event), event);
      on.end?.(...place(event), event);
    }
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("pointerleave", () => on.leave?.());
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (on.passes?.(event)) return;
      event.preventDefault();
      const pixels = event.deltaMode === 1 ? 16 : 1;
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
        on.drag?.(-(event.deltaX || event.deltaY) * pixels, 0, ...place(event), event);
      } else on.zoom?.(Math.exp(-event.deltaY * pixels * 0.0016), ...place(event), event);
    },
    { passive: false },
  );
}

function span(down) {
  const [a, b] = [...down.values()];
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
