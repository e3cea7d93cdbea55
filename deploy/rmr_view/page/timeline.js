// The timeline: a lane per robot with its intervals and deadlines, who leads, faults as bands; a click seeks.
//
// A lane has its robot's hue; the strength says how far the passage is: asking (hatched), waiting (faint), claiming
// (half), inside (full). A deadline is a triangle; a missed one is a red cross with the lateness as a red bar.
// Lanes are drawn into a canvas of their own when data, window, size or theme change; the playhead is drawn on top.

import { ALERT, faded, robotColour, inkOn, theme } from "./palette.js";
import { clockText, deadlineState, faultBegin, faultEnd, faultText, leadersAt, stateText } from "./run_facts.js";
import { fit, gestures } from "./surface.js";
import { star } from "./floor.js";

export const GUTTER = 46;
const RULER = 24;
const LANE_MAX = 28;
const LANE_MIN = 11;
const HIT = 7; // pixels around a cross within which a click means it
const STEPS_S = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600];
const STRENGTH = { asking: 0.16, waiting: 0.26, claiming: 0.55, inside: 1 };

export class Timeline {
  /** `source` gives {run, timeline, selected, t, begin, end, live}; `on` has seek(t), choose(robot), explain(robot, job), hover(text, x, y). */
  constructor(canvas, source, on) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.still = document.createElement("canvas");
    this.source = source;
    this.on = on;
    this.window = null; // [begin, end] in seconds; null: the whole run
    this.key = "";
    this.patterns = new Map();
    let scrubbing = false;
    gestures(canvas, {
      passes: (event) => !event.ctrlKey && !event.metaKey && !event.shiftKey && this.overflows() && event.deltaY !== 0,
      begin: (x, y) => (scrubbing = x > GUTTER && y < RULER),
      drag: (dx, dy, x, y, event) => {
        if (event.type !== "wheel" && (scrubbing || !this.window)) on.seek(this.time(x));
        else this.pan(dx);
      },
      zoom: (factor, x) => this.zoom(factor, x),
      click: (x, y) => this.click(x, y),
      hover: (x, y) => on.hover(this.describe(x, y), x, y),
      leave: () => on.hover(null, 0, 0),
    });
    canvas.addEventListener("dblclick", () => this.whole());
  }

  /** Return the height of all lanes in CSS pixels, if `room` is there. */
  height(room) {
    const count = Math.max(1, this.source.run?.robots.length ?? 1);
    const lane = Math.min(LANE_MAX, Math.max(LANE_MIN, (room - RULER - 6) / count));
    return Math.round(RULER + lane * count + 6);
  }

  overflows() {
    const box = this.canvas.parentElement;
    return box.scrollHeight > box.clientHeight + 1;
  }

  // -- the window of time -----------------------------------------------------------------------------------

  span() {
    return this.window ?? [this.source.begin, this.last()];
  }

  /** The end of the axis: that of the run, and deadlines beyond it if they are not far away. */
  last() {
    const { begin, end, timeline } = this.source;
    if (timeline !== this.dueOf) {
      this.dueOf = timeline;
      const all = (timeline?.lanes ?? []).flatMap((lane) => lane.deadlines.map((one) => one.deadline_s));
      this.due = all.reduce((a, b) => Math.max(a, b), 0);
    }
    const far = begin + Math.max(2 * (end - begin), 40);
    const beyond = this.due > end ? Math.min(this.due + 0.02 * (this.due - begin), far) : end;
    return Math.max(end, beyond, begin + 1);
  }

  whole() {
    this.window = null;
  }

  zoom(factor, x = null) {
    const [a, b] = this.span();
    const all = Math.max(1, this.last() - this.source.begin);
    const wide = Math.max(0.05, (b - a) / factor);
    if (wide >= all) {
      this.window = null;
      return;
    }
    const at = x === null ? Math.min(b, Math.max(a, this.source.t)) : this.time(x);
    const share = (at - a) / (b - a);
    this.window = this.bounded(at - share * wide, wide);
  }

  pan(dx) {
    if (!this.window) return;
    const [a, b] = this.window;
    this.window = this.bounded(a - (dx / this.plot) * (b - a), b - a);
  }

  bounded(begin, wide) {
    const first = Math.max(this.source.begin, Math.min(begin, this.last() - wide));
    return [first, first + wide];
  }

  /** A window that follows the playhead when that would leave it. */
  follow(t) {
    if (!this.window || !this.source.moving) return;
    const [a, b] = this.window;
    if (t > b - (b - a) * 0.08 || t < a) this.window = this.bounded(t - (b - a) * 0.25, b - a);
  }

  time(x) {
    const [a, b] = this.span();
    return Math.min(b, Math.max(a, a + ((x - GUTTER) / this.plot) * (b - a)));
  }

  px(t) {
    const [a, b] = this.span();
    return GUTTER + ((t - a) / (b - a)) * this.plot;
  }

  laneAt(y) {
    const robots = this.source.run?.robots ?? [];
    const place = Math.floor((y - RULER) / this.lane);
    return y >= RULER && place < robots.length ? place : null;
  }

  /** Where `box` has to be scrolled to so that the lane of `robot` is in it. */
  scrollFor(robot, box) {
    const place = this.source.run?.robots.indexOf(robot) ?? -1;
    if (place < 0 || !this.lane) return box.scrollTop;
    const top = this.top(place);
    if (top < box.scrollTop + RULER) return top - RULER;
    return Math.max(box.scrollTop, top + this.lane + 6 - box.clientHeight);
  }

  click(x, y) {
    const place = this.laneAt(y);
    if (place !== null) this.on.choose(this.source.run.robots[place]);
    if (x <= GUTTER) return;
    this.on.seek(this.time(x));
    const miss = place === null ? null : this.missAt(x, this.source.run.robots[place]);
    if (miss) this.on.explain(this.source.run.robots[place], miss);
  }

  /** The missed job of `robot` whose cross or red bar is at `x`. */
  missAt(x, robot) {
    const lane = (this.source.timeline?.lanes ?? []).find((one) => one.robot === robot);
    const missed = (lane?.deadlines ?? []).filter((one) => deadlineState(one, this.source.end) === "missed");
    return missed.find((one) => x >= this.px(one.deadline_s) - HIT && x <= this.px(one.finish_s ?? this.source.end) + 1) ?? null;
  }

  // -- drawing ----------------------------------------------------------------------------------------------

  draw() {
    const { run, t } = this.source;
    const size = fit(this.canvas);
    if (!run || !size.width || !size.height) return;
    this.width = size.width;
    this.boxHeight = size.height;
    this.plot = Math.max(10, size.width - GUTTER - 10);
    this.lane = (size.height - RULER - 6) / Math.max(1, run.robots.length);
    this.colours = theme();
    this.follow(t);
    this.drawStill(size);
    const c = this.context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.drawImage(this.still, 0, 0);
    c.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    this.playhead(c, t);
  }

  drawStill(size) {
    const { timeline, selected } = this.source;
    const key = [...this.span(), this.source.end, this.canvas.width, this.canvas.height, this.colours.dark, selected].join();
    if (key === this.key && timeline === this.drawnTimeline) return;
    this.key = key;
    this.drawnTimeline = timeline;
    this.still.width = this.canvas.width;
    this.still.height = this.canvas.height;
    const c = this.still.getContext("2d", { alpha: false });
    c.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    c.fillStyle = this.colours.panel;
    c.fillRect(0, 0, this.width, this.boxHeight);
    const lanes = new Map((timeline?.lanes ?? []).map((lane) => [lane.robot, lane]));
    this.source.run.robots.forEach((robot, place) => this.ground(c, place, robot));
    this.ruler(c);
    c.save();
    c.beginPath();
    c.rect(GUTTER, 0, this.width - GUTTER, this.boxHeight);
    c.clip();
    this.future(c);
    for (const fault of timeline?.faults ?? []) this.fault(c, fault);
    this.source.run.robots.forEach((robot, place) => this.drawLane(c, place, lanes.get(robot)));
    for (const reign of timeline?.leaders ?? []) this.reign(c, reign);
    this.source.run.robots.forEach((robot, place) => this.deadlines(c, place, lanes.get(robot)));
    c.restore();
  }

  top(place) {
    return RULER + place * this.lane;
  }

  ground(c, place, robot) {
    const [y, tall] = [this.top(place), this.lane];
    const gap = tall > 16 ? 2 : 0.5;
    c.fillStyle = this.colours.lane;
    c.fillRect(GUTTER, y + gap, this.plot, tall - 2 * gap);
    const chosen = robot === this.source.selected;
    const colour = robotColour(robot);
    const radius = Math.min(9, tall * 0.42);
    c.fillStyle = colour;
    c.beginPath();
    c.arc(GUTTER - 16, y + tall / 2, radius, 0, 7);
    c.fill();
    if (chosen) {
      c.strokeStyle = this.colours.accent;
      c.lineWidth = 2;
      c.beginPath();
      c.arc(GUTTER - 16, y + tall / 2, radius + 2.5, 0, 7);
      c.stroke();
    }
    c.fillStyle = inkOn(colour);
    c.font = `600 ${Math.min(11, radius * 1.25).toFixed(1)}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.fillText(String(robot), GUTTER - 16, y + tall / 2 + radius * 0.42);
  }

  ruler(c) {
    const [a, b] = this.span();
    const step = STEPS_S.find((one) => (one / (b - a)) * this.plot >= 62) ?? 7200;
    const digits = step >= 1 ? 0 : step >= 0.1 ? 1 : 2;
    c.font = "11px system-ui, sans-serif";
    c.textAlign = "center";
    c.fillStyle = this.colours.muted;
    c.strokeStyle = this.colours.line;
    c.lineWidth = 1;
    c.beginPath();
    for (let i = Math.ceil(a / step); i * step <= b + 1e-9; i++) {
      const x = Math.round(this.px(i * step)) + 0.5;
      c.moveTo(x, RULER - 5);
      c.lineTo(x, this.boxHeight - 4);
      c.fillText(clockText(i * step, digits), Math.min(x, this.width - 18), 14);
    }
    c.stroke();
  }

  /** Shade what lies beyond the end of the run, or has not come yet. */
  future(c) {
    const x = this.px(this.source.end);
    if (x >= this.width - 10) return;
    c.fillStyle = faded(this.colours.dark ? "#0e1116" : "#ffffff", 0.62);
    c.fillRect(x, RULER - 4, this.width, this.boxHeight);
  }

  fault(c, fault) {
    const [begin, end] = [this.px(faultBegin(fault)), this.px(Math.min(faultEnd(fault), this.source.end))];
    c.fillStyle = faded(ALERT, 0.11);
    c.fillRect(begin, RULER - 5, Math.max(0, end - begin), this.boxHeight - RULER + 5);
    c.strokeStyle = faded(ALERT, 0.7);
    c.lineWidth = 1;
    c.setLineDash([3, 3]);
    c.beginPath();
    for (const x of end > begin + 1 ? [begin, end] : [begin]) {
      c.moveTo(x, RULER - 5);
      c.lineTo(x, this.boxHeight - 4);
    }
    c.stroke();
    c.setLineDash([]);
    c.fillStyle = ALERT;
    c.fillRect(begin, RULER - 5, Math.max(2, end - begin), 3);
  }

  /** Actions that began outside of turns, as bars with their names; one that failed has the colour of alarm. */
  drawActions(c, place, lane, inset) {
    for (const one of freeActions(lane)) {
      const begin = Math.max(GUTTER, this.px(one.begin_s));
      const end = Math.min(this.width, this.px(Math.min(one.until_s, this.source.end)));
      if (end < GUTTER || begin > this.width) continue;
      const [y, wide, tall] = [this.top(place) + inset, Math.max(1, end - begin - 1), this.lane - 2 * inset];
      c.fillStyle = faded(one.failure ? ALERT : robotColour(lane.robot), 0.4);
      c.fillRect(begin, y, wide, tall);
      if (tall < 10 || wide < 40) continue;
      c.save();
      c.beginPath();
      c.rect(begin, y, wide, tall);
      c.clip();
      c.fillStyle = this.colours.text;
      c.font = "10px system-ui, sans-serif";
      c.textAlign = "left";
      c.fillText(one.action, begin + 4, y + tall / 2 + 3.5);
      c.restore();
    }
  }

  drawLane(c, place, lane) {
    const inset = this.lane > 16 ? 5 : this.lane > 8 ? 2 : 1;
    if (lane) this.drawActions(c, place, lane, inset);
    for (const one of lane?.intervals ?? []) {
      const begin = Math.max(GUTTER, this.px(one.begin_s));
      const end = Math.min(this.width, this.px(one.open ? this.source.end : one.end_s));
      if (end < GUTTER || begin > this.width) continue;
      const box = [begin, this.top(place) + inset, Math.max(1, end - begin), this.lane - 2 * inset];
      this.interval(c, one.kind, robotColour(lane.robot), box);
    }
  }

  interval(c, kind, colour, box) {
    if (kind === "dead") {
      c.fillStyle = faded(ALERT, 0.3);
      c.fillRect(...box);
      c.fillStyle = this.hatch(c, ALERT, true);
    } else if (kind === "stopped") c.fillStyle = this.hatch(c, this.colours.muted, true);
    else if (kind === "stalled") c.fillStyle = this.hatch(c, ALERT, false);
    else if (kind === "asking") {
      c.fillStyle = this.hatch(c, colour, false);
    } else c.fillStyle = faded(colour, STRENGTH[kind] ?? 0.2);
    c.fillRect(...box);
    if (kind === "claiming" || kind === "asking") {
      c.strokeStyle = colour;
      c.lineWidth = 1;
      c.strokeRect(box[0] + 0.5, box[1] + 0.5, Math.max(0, box[2] - 1), box[3] - 1);
    }
  }

  hatch(c, colour, crossed) {
    const key = colour + crossed;
    if (!this.patterns.has(key)) {
      const tile = document.createElement("canvas");
      tile.width = tile.height = 6;
      const d = tile.getContext("2d");
      d.strokeStyle = colour;
      d.lineWidth = 1.4;
      d.beginPath();
      for (const at of [-6, 0, 6]) {
        d.moveTo(at, 6);
        d.lineTo(at + 6, 0);
        if (crossed) {
          d.moveTo(at, 0);
          d.lineTo(at + 6, 6);
        }
      }
      d.stroke();
      this.patterns.set(key, c.createPattern(tile, "repeat"));
    }
    return this.patterns.get(key);
  }

  reign(c, reign) {
    const place = this.source.run.robots.indexOf(reign.robot);
    if (place < 0) return;
    const begin = this.px(reign.begin_s);
    const end = this.px(Math.min(reign.end_s ?? Infinity, this.source.end));
    const y = this.top(place) + (this.lane > 16 ? 2 : 0);
    c.fillStyle = this.colours.text;
    c.fillRect(begin, y, Math.max(1, end - begin), 2);
    if (this.lane > 11) star(c, Math.max(GUTTER + 7, begin + 1), y + 4, 5.5, { ...this.colours, halo: this.colours.lane });
  }

  deadlines(c, place, lane) {
    const middle = this.top(place) + this.lane / 2;
    const size = Math.min(5.5, this.lane * 0.32);
    for (const one of lane?.deadlines ?? []) {
      const state = deadlineState(one, this.source.end);
      if (state === "missed") this.miss(c, one, middle, size);
      else this.mark(c, one, middle, size, state);
    }
  }

  mark(c, one, middle, size, state) {
    const x = this.px(one.deadline_s);
    c.strokeStyle = c.fillStyle = state === "met" ? this.colours.good : this.colours.muted;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(x - size, middle - size);
    c.lineTo(x + size, middle - size);
    c.lineTo(x, middle + size);
    c.closePath();
    if (state === "met") c.stroke();
    else c.fill();
    if (one.finish_s === null || one.finish_s === undefined) return;
    c.beginPath();
    c.arc(this.px(one.finish_s), middle, size * 0.8, 0, 7);
    c.fillStyle = this.colours.good;
    c.fill();
    c.strokeStyle = this.colours.lane;
    c.stroke();
  }

  miss(c, one, middle, size) {
    const x = this.px(one.deadline_s);
    const end = this.px(one.finish_s ?? this.source.end);
    c.fillStyle = this.colours.alert;
    c.fillRect(x, middle - 1.5, Math.max(0, end - x), 3);
    c.strokeStyle = this.colours.lane;
    c.lineWidth = 5;
    cross(c, x, middle, size);
    c.strokeStyle = this.colours.alert;
    c.lineWidth = 2.5;
    cross(c, x, middle, size);
  }

  playhead(c, t) {
    const x = this.px(t);
    if (x < GUTTER - 1 || x > this.width) return;
    c.strokeStyle = this.colours.accent;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(x, RULER - 6);
    c.lineTo(x, this.boxHeight);
    c.stroke();
    c.fillStyle = this.colours.accent;
    c.beginPath();
    c.moveTo(x - 5, RULER - 11);
    c.lineTo(x + 5, RULER - 11);
    c.lineTo(x, RULER - 4);
    c.fill();
  }

  /** What lies under a place, in a sentence; null if nothing does. */
  describe(x, y) {
    const { timeline, run } = this.source;
    if (!timeline || !run || !this.plot || x < GUTTER) return null;
    const t = this.time(x);
    const near = 6 / this.plot;
    const [a, b] = this.span();
    const place = this.laneAt(y);
    const robot = place === null ? null : run.robots[place];
    const lines = [];
    const lane = (timeline.lanes ?? []).find((one) => one.robot === robot);
    for (const one of lane?.deadlines ?? []) {
      if (Math.abs(one.deadline_s - t) < near * (b - a)) lines.push(deadlineText(one, this.source.end));
    }
    const interval = lane?.intervals.findLast((one) => one.begin_s <= t && (t < one.end_s || one.open));
    if (interval) {
      const event = interval.event ? `, ${interval.event}` : "";
      lines.push(`Robot ${robot} ${stateText(interval.kind)}${event}: ${clockText(interval.begin_s)} to ${interval.open ? "now" : clockText(interval.end_s)}`);
    }
    for (const one of lane ? freeActions(lane) : []) {
      if (one.begin_s > t || t > one.until_s) continue;
      const failed = one.failure ? `, failed: ${one.failure}` : "";
      lines.push(`Robot ${robot} ${one.action}: ${clockText(one.begin_s)} to ${one.open ? "now" : clockText(one.end_s)}${failed}`);
    }
    if (robot !== null && leadersAt(timeline, t).has(robot)) lines.push(`Robot ${robot} leads`);
    for (const fault of timeline.faults ?? []) {
      const begin = faultBegin(fault);
      if (begin <= t + near * (b - a) && t <= Math.max(faultEnd(fault), begin + near * (b - a))) lines.push(`Fault: ${faultText(fault)}`);
    }
    return lines.length ? [clockText(t, 2), ...lines] : null;
  }
}

const free = new WeakMap(); // by lane: the timeline is drawn far more often than it comes

/** A robot's drives and other actions that began while it had and awaited no turn, until the next one: `until_s`. */
function freeActions(lane) {
  if (!free.has(lane)) {
    const turns = lane.intervals.filter((one) => one.kind in STRENGTH);
    const during = (t) => turns.some((one) => one.begin_s <= t && (t < one.end_s || one.open));
    const next = (t) => turns.find((one) => one.begin_s > t)?.begin_s ?? Infinity;
    const begun = lane.actions.filter((one) => !during(one.begin_s));
    const over = (one) => (one.open ? Infinity : one.end_s);
    free.set(lane, begun.map((one) => ({ ...one, until_s: Math.min(over(one), next(one.begin_s)) })));
  }
  return free.get(lane);
}

function deadlineText(one, end) {
  const state = deadlineState(one, end);
  const done = one.finish_s === null || one.finish_s === undefined ? "" : `, finished at ${clockText(one.finish_s)}`;
  const words = { met: "met", missed: "missed", open: "open", later: "not begun" };
  const ask = state === "missed" ? "; click: why" : "";
  return `Deadline of ${one.job} at ${clockText(one.deadline_s)}: ${words[state]}${done}${ask}`;
}

function cross(c, x, y, size) {
  c.beginPath();
  c.moveTo(x - size, y - size);
  c.lineTo(x + size, y + size);
  c.moveTo(x - size, y + size);
  c.lineTo(x + size, y - size);
  c.stroke();
}
