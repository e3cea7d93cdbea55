// The floor: obstacles, areas, queues, and the robots with headings, trails, routes, fields of view and frames.
//
// What does not move is drawn once into a canvas of its own and copied in every frame; it is drawn anew when view,
// theme or size change. World coordinates are metres with y upwards; `view` says which of them lie where.

import { ALERT, faded, inkOn, robotColour, theme } from "./palette.js";
import { hasMissed, intervalAt, isGone } from "./run_facts.js";
import { fit, gestures } from "./surface.js";

const TRAIL_S = 6;
const FRAME_S = 0.25; // how long a frame on the air stays visible
const MARGIN = 26;
const TOP = 46; // room for the layer buttons above the floor
const GRID_M = [0.1, 0.25, 0.5, 1, 2, 5, 10, 25, 50, 100];

export class Floor {
  /** `source` gives {run, timeline, selected, layers, poses, frames, routes, leaders, t}. */
  constructor(canvas, source, on) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.still = document.createElement("canvas");
    this.source = source;
    this.on = on;
    this.view = null;
    this.fitted = true;
    this.drawn = new Map(); // robot -> {x, y, heading} of the last frame, metres and radians
    this.frames = 0;
    this.linked = 0; // frames on the air in the last frame drawn
    this.stillKey = "";
    gestures(canvas, {
      drag: (dx, dy) => this.pan(dx, dy),
      zoom: (factor, x, y) => this.zoom(factor, x, y),
      click: (x, y) => on.choose(this.robotAt(x, y)),
      hover: (x, y) => on.hover(this.robotAt(x, y), x, y),
      leave: () => on.hover(null, 0, 0),
    });
    canvas.addEventListener("dblclick", () => this.fit());
  }

  // -- the view ---------------------------------------------------------------------------------------------

  fit() {
    this.fitted = true;
    this.view = null;
  }

  pan(dx, dy) {
    if (!this.view) return;
    this.view.x -= dx / this.view.scale;
    this.view.y += dy / this.view.scale;
    this.changed();
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    if (!this.view) return;
    const [wx, wy] = this.toWorld(x, y);
    const least = 0.2 * this.fitScale();
    this.view.scale = Math.min(5000, Math.max(least, this.view.scale * factor));
    const [nx, ny] = this.toWorld(x, y);
    this.view.x += wx - nx;
    this.view.y += wy - ny;
    this.changed();
  }

  changed() {
    this.fitted = false;
    const { width, height } = this.source.run.floor;
    this.view.x = Math.min(width, Math.max(0, this.view.x));
    this.view.y = Math.min(height, Math.max(0, this.view.y));
  }

  fitScale() {
    const { width, height } = this.source.run.floor;
    return Math.max(1, Math.min((this.width - 2 * MARGIN) / width, (this.height - MARGIN - TOP) / height));
  }

  toWorld(px, py) {
    const { x, y, scale } = this.view;
    return [x + (px - this.width / 2) / scale, y - (py - this.height / 2) / scale];
  }

  px(x) {
    return this.width / 2 + (x - this.view.x) * this.view.scale;
  }

  py(y) {
    return this.height / 2 - (y - this.view.y) * this.view.scale;
  }

  robotAt(px, py) {
    if (!this.view) return null;
    const [x, y] = this.toWorld(px, py);
    const reach = Math.max(this.source.run.floor.shape.radius, 12 / this.view.scale);
    let best = null;
    let least = reach;
    for (const [robot, pose] of this.drawn) {
      const away = Math.hypot(pose.x - x, pose.y - y);
      if (away <= least) [best, least] = [robot, away];
    }
    return best;
  }

  // -- drawing ----------------------------------------------------------------------------------------------

  draw() {
    const { run } = this.source;
    const size = fit(this.canvas);
    if (!run || !size.width || !size.height) return;
    this.width = size.width;
    this.height = size.height;
    this.colours = theme();
    if (!this.view || (this.fitted && size.changed)) {
      const scale = this.fitScale();
      this.view = { x: run.floor.width / 2, y: run.floor.height / 2 + (TOP - MARGIN) / 2 / scale, scale };
    }
    this.drawStill(size);
    const c = this.context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.drawImage(this.still, 0, 0);
    c.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    this.drawMoving(c);
    this.frames += 1;
  }

  drawStill(size) {
    const { x, y, scale } = this.view;
    const layers = this.source.layers;
    const key = [this.canvas.width, this.canvas.height, x, y, scale, this.colours.dark, layers.areas].join();
    if (key === this.stillKey) return;
    this.stillKey = key;
    this.still.width = this.canvas.width;
    this.still.height = this.canvas.height;
    const c = this.still.getContext("2d", { alpha: false });
    c.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    c.fillStyle = this.colours.ground;
    c.fillRect(0, 0, this.width, this.height);
    this.ground(c);
    if (layers.areas) for (const area of this.source.run.floor.areas) this.area(c, area);
    for (const obstacle of this.source.run.floor.obstacles) this.obstacle(c, obstacle);
    this.walls(c);
    for (const beacon of this.source.run.floor.beacons ?? []) this.beacon(c, beacon);
    this.scaleBar(c);
  }

  ground(c) {
    const { width, height } = this.source.run.floor;
    const { scale } = this.view;
    c.save();
    c.shadowColor = this.colours.shade;
    c.shadowBlur = 18;
    c.shadowOffsetY = 4;
    c.fillStyle = this.colours.floor;
    c.fillRect(this.px(0), this.py(height), width * scale, height * scale);
    c.restore();
    const step = GRID_M.find((metres) => metres * scale >= 34) ?? 100;
    c.strokeStyle = this.colours.grid;
    c.lineWidth = 1;
    c.beginPath();
    for (let x = step; x < width - 1e-6; x += step) line(c, this.px(x), this.py(0), this.px(x), this.py(height));
    for (let y = step; y < height - 1e-6; y += step) line(c, this.px(0), this.py(y), this.px(width), this.py(y));
    c.stroke();
  }

  walls(c) {
    const { width, height } = this.source.run.floor;
    c.strokeStyle = this.colours.wall;
    c.lineWidth = 2;
    c.strokeRect(this.px(0), this.py(height), width * this.view.scale, height * this.view.scale);
  }

  obstacle(c, obstacle) {
    c.beginPath();
    if (obstacle.centre) c.arc(this.px(obstacle.centre[0]), this.py(obstacle.centre[1]), obstacle.radius * this.view.scale, 0, 7);
    else {
      for (const [x, y] of obstacle.corners) c.lineTo(this.px(x), this.py(y));
      c.closePath();
    }
    c.fillStyle = this.colours.obstacle;
    c.fill();
    c.strokeStyle = this.colours.obstacleEdge;
    c.lineWidth = 1;
    c.stroke();
  }

  area(c, area) {
    const radius = this.source.run.floor.shape.radius * this.view.scale;
    c.strokeStyle = this.colours.area;
    c.lineWidth = 1;
    c.setLineDash([3, 4]);
    if (area.queue.length) this.queue(c, area.queue, radius);
    if (area.box) {
      const [x0, y0, x1, y1] = area.box;
      c.fillStyle = this.colours.areaFill;
      c.fillRect(this.px(x0), this.py(y1), (x1 - x0) * this.view.scale, (y1 - y0) * this.view.scale);
      c.strokeRect(this.px(x0), this.py(y1), (x1 - x0) * this.view.scale, (y1 - y0) * this.view.scale);
    }
    c.fillStyle = this.colours.areaFill;
    if (!area.box) {
      for (const [x, y] of area.places) {
        c.beginPath();
        c.arc(this.px(x), this.py(y), radius, 0, 7);
        c.fill();
        c.stroke();
      }
    }
    c.setLineDash([]);
    this.label(c, area, radius);
  }

  queue(c, places, radius) {
    c.save();
    c.globalAlpha = 0.75;
    c.beginPath();
    for (const [x, y] of places) c.lineTo(this.px(x), this.py(y));
    c.stroke();
    c.setLineDash([]);
    for (const [x, y] of places) {
      c.beginPath();
      c.arc(this.px(x), this.py(y), Math.max(2, radius * 0.22), 0, 7);
      c.fillStyle = this.colours.floor;
      c.fill();
      c.stroke();
    }
    c.restore();
  }

  label(c, area, radius) {
    const top = area.box ? [(area.box[0] + area.box[2]) / 2, area.box[3]] : area.places.reduce((a, b) => (b[1] > a[1] ? b : a));
    c.font = "500 12px system-ui, sans-serif";
    c.textAlign = "center";
    c.fillStyle = this.colours.muted;
    const y = this.py(top[1]) - (area.box ? 6 : radius + 6);
    if (y > this.py(this.source.run.floor.height) + 10) c.fillText(area.name, this.px(top[0]), y);
    else c.fillText(area.name, this.px(top[0]), this.py(top[1]) + radius + 15);
  }

  beacon(c, [x, y]) {
    const [px, py] = [this.px(x), this.py(y)];
    c.fillStyle = this.colours.muted;
    c.beginPath();
    c.moveTo(px, py - 5);
    c.lineTo(px + 5, py);
    c.lineTo(px, py + 5);
    c.lineTo(px - 5, py);
    c.fill();
  }

  scaleBar(c) {
    const metres = [...GRID_M].reverse().find((one) => one * this.view.scale <= 110) ?? GRID_M[0];
    const long = metres * this.view.scale;
    const [x, y] = [14, this.height - 12];
    c.strokeStyle = this.colours.muted;
    c.fillStyle = this.colours.muted;
    c.lineWidth = 1.5;
    c.beginPath();
    line(c, x, y, x + long, y);
    line(c, x, y - 3, x, y + 3);
    line(c, x + long, y - 3, x + long, y + 3);
    c.stroke();
    c.font = "11px system-ui, sans-serif";
    c.textAlign = "left";
    c.fillText(metres < 1 ? `${Math.round(metres * 100)} cm` : `${metres} m`, x + long + 7, y + 4);
  }

  // -- what moves -------------------------------------------------------------------------------------------

  drawMoving(c) {
    const { run, layers, poses, selected, t } = this.source;
    this.drawn.clear();
    this.linked = 0;
    for (const robot of run.robots) {
      const at = poses.at(robot, t);
      if (at) this.drawn.set(robot, { x: at[0], y: at[1], heading: at[2] });
    }
    if (layers.trails) for (const robot of this.drawn.keys()) this.trail(c, robot, t);
    if (layers.routes) this.routes(c, t);
    if (layers.views) for (const [robot, pose] of this.drawn) this.viewCone(c, robot, pose, robot === selected);
    if (layers.links) this.links(c, t);
    if (layers.estimates) for (const robot of this.drawn.keys()) this.estimate(c, robot, t);
    const leaders = this.source.leaders(t);
    for (const [robot, pose] of this.drawn) if (robot !== selected) this.robot(c, robot, pose, t, leaders);
    if (this.drawn.has(selected)) this.robot(c, selected, this.drawn.get(selected), t, leaders);
  }

  trail(c, robot, t) {
    const points = [];
    this.source.poses.trail(robot, t - TRAIL_S, t, (x, y) => points.push(x, y));
    const { x, y } = this.drawn.get(robot);
    points.push(x, y);
    const colour = robotColour(robot);
    c.lineJoin = "round";
    c.lineCap = "butt"; // round ends would show as dots where two pieces meet
    c.lineWidth = Math.max(1.5, 0.025 * this.view.scale);
    // Three pieces of growing strength; one piece per point would cost a stroke each.
    const count = points.length / 2;
    for (let piece = 0; piece < 3; piece++) {
      const first = Math.floor((piece * (count - 1)) / 3);
      const last = Math.floor(((piece + 1) * (count - 1)) / 3);
      if (last <= first) continue;
      c.strokeStyle = faded(colour, [0.12, 0.25, 0.45][piece]);
      c.beginPath();
      for (let i = first; i <= last; i++) c.lineTo(this.px(points[2 * i]), this.py(points[2 * i + 1]));
      c.stroke();
    }
  }

  routes(c, t) {
    const { selected } = this.source;
    for (const [robot, points] of this.source.routes(t)) {
      const pose = this.drawn.get(robot);
      if (!pose || points.length < 2) continue;
      const chosen = robot === selected;
      const colour = robotColour(robot);
      c.strokeStyle = faded(colour, chosen ? 1 : 0.55);
      c.lineWidth = chosen ? 2 : 1.25;
      c.setLineDash(chosen ? [7, 5] : [2, 5]);
      c.beginPath();
      c.moveTo(this.px(pose.x), this.py(pose.y));
      for (const [x, y] of ahead(points, pose)) c.lineTo(this.px(x), this.py(y));
      c.stroke();
      c.setLineDash([]);
      const [ex, ey] = points[points.length - 1];
      cross(c, this.px(ex), this.py(ey), chosen ? 5 : 3.5);
    }
  }

  viewCone(c, robot, pose, chosen) {
    const { view_angle: angle, view_depth: depth } = this.source.run.floor.shape;
    if (!depth || !angle) return;
    const [x, y] = [this.px(pose.x), this.py(pose.y)];
    c.beginPath();
    c.moveTo(x, y);
    c.arc(x, y, depth * this.view.scale, -pose.heading - angle / 2, -pose.heading + angle / 2);
    c.closePath();
    c.fillStyle = faded(robotColour(robot), chosen ? 0.26 : 0.13);
    c.fill();
  }

  /** Frames on the air: to one robot a line, to all a ring that grows; lost ones are dashed and crossed out. */
  links(c, t) {
    for (const frame of this.source.frames(t - FRAME_S, t)) {
      const from = this.drawn.get(frame.source);
      if (!from) continue;
      const age = (t - frame.start_s) / FRAME_S;
      if (age < 0 || age > 1) continue;
      this.linked += 1;
      const to = frame.destination === null ? null : this.drawn.get(frame.destination);
      if (to) this.link(c, frame, from, to, age);
      else if (frame.destination === null) this.ring(c, frame.source, from, age);
    }
  }

  link(c, frame, from, to, age) {
    const lost = frame.outcome === "no_ack" || frame.outcome === "access_failure";
    const [x0, y0, x1, y1] = [this.px(from.x), this.py(from.y), this.px(to.x), this.py(to.y)];
    const colour = lost ? ALERT : robotColour(frame.source);
    c.strokeStyle = faded(colour, 0.9 * (1 - age));
    c.lineWidth = frame.attempt ? 1.25 : 2.25;
    c.setLineDash(lost ? [5, 4] : []);
    c.beginPath();
    line(c, x0, y0, x1, y1);
    c.stroke();
    c.setLineDash([]);
    if (lost) cross(c, (x0 + x1) / 2, (y0 + y1) / 2, 5);
    else {
      c.fillStyle = c.strokeStyle;
      const share = Math.min(1, age * 2);
      c.beginPath();
      c.arc(x0 + share * (x1 - x0), y0 + share * (y1 - y0), 3, 0, 7);
      c.fill();
    }
  }

  ring(c, robot, from, age) {
    const radius = (this.source.run.floor.shape.radius + 0.11 * age) * this.view.scale;
    c.strokeStyle = faded(robotColour(robot), 0.5 * (1 - age));
    c.lineWidth = 1.5;
    c.beginPath();
    c.arc(this.px(from.x), this.py(from.y), radius, 0, 7);
    c.stroke();
  }

  estimate(c, robot, t) {
    const at = this.source.poses.at(robot, t, true);
    if (!at) return;
    const radius = this.radius();
    const [x, y] = [this.px(at[0]), this.py(at[1])];
    c.strokeStyle = this.colours.text;
    c.lineWidth = 1;
    c.setLineDash([3, 3]);
    c.beginPath();
    c.arc(x, y, radius + 3, 0, 7);
    c.moveTo(x, y);
    c.lineTo(x + Math.cos(at[2]) * radius * 1.9, y - Math.sin(at[2]) * radius * 1.9);
    c.stroke();
    c.setLineDash([]);
    cross(c, x, y, 4);
  }

  radius() {
    return Math.max(5, this.source.run.floor.shape.radius * this.view.scale);
  }

  robot(c, robot, pose, t, leaders) {
    const radius = this.radius();
    const [x, y] = [this.px(pose.x), this.py(pose.y)];
    if (x < -60 || y < -60 || x > this.width + 60 || y > this.height + 60) return;
    const { timeline, selected } = this.source;
    const kind = intervalAt(timeline, robot, t)?.kind;
    const colour = isGone(kind) ? this.colours.muted : robotColour(robot);
    this.rings(c, x, y, radius, kind, robot === selected);
    nose(c, x, y, radius, pose.heading);
    c.fillStyle = colour;
    c.strokeStyle = this.colours.dark ? "rgba(255,255,255,0.55)" : "rgba(20,24,29,0.55)";
    c.lineWidth = 1;
    c.fill();
    c.stroke();
    c.beginPath();
    c.arc(x, y, radius, 0, 7);
    c.fill();
    c.stroke();
    this.number(c, robot, x, y, radius, colour);
    if (isGone(kind)) {
      c.strokeStyle = kind === "dead" ? ALERT : this.colours.text;
      c.lineWidth = 3;
      cross(c, x, y, radius * 0.8);
    }
    const badge = Math.max(4, Math.min(9, radius * 0.5));
    if (leaders.has(robot)) star(c, x + radius * 0.85, y - radius * 0.85, badge, this.colours);
    if (hasMissed(timeline, robot, t)) warning(c, x - radius * 0.9, y - radius * 0.9, badge, this.colours);
  }

  rings(c, x, y, radius, kind, chosen) {
    if (chosen) {
      c.beginPath();
      c.arc(x, y, radius + 7, 0, 7);
      c.strokeStyle = this.colours.accent;
      c.lineWidth = 2.5;
      c.stroke();
    }
    if (kind !== "inside" && kind !== "claiming" && kind !== "stalled") return;
    c.beginPath();
    c.arc(x, y, radius + 3, 0, 7);
    c.setLineDash(kind === "inside" ? [] : [4, 3]);
    c.strokeStyle = kind === "stalled" ? ALERT : this.colours.text;
    c.lineWidth = 1.5;
    c.stroke();
    c.setLineDash([]);
  }

  number(c, robot, x, y, radius, colour) {
    if (radius < 7) return;
    const text = String(robot);
    const size = Math.min(22, radius * (text.length > 2 ? 0.75 : text.length > 1 ? 0.95 : 1.15));
    c.fillStyle = colour.length === 7 ? inkOn(colour) : "#fff";
    c.font = `600 ${size.toFixed(1)}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.fillText(text, x, y + size * 0.35);
  }
}

/** The points of a route from the one nearest to the robot on, without those it has passed. */
function ahead(points, pose) {
  let first = 1;
  let least = Infinity;
  for (let i = 0; i + 1 < points.length; i++) {
    const away = fromSegment(pose, points[i], points[i + 1]);
    if (away < least) [first, least] = [i + 1, away];
  }
  return points.slice(first);
}

function fromSegment(pose, [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay];
  const long = dx * dx + dy * dy;
  const share = long ? Math.min(1, Math.max(0, ((pose.x - ax) * dx + (pose.y - ay) * dy) / long)) : 0;
  return Math.hypot(ax + share * dx - pose.x, ay + share * dy - pose.y);
}

function line(c, x0, y0, x1, y1) {
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
}

function cross(c, x, y, size) {
  c.beginPath();
  line(c, x - size, y - size, x + size, y + size);
  line(c, x - size, y + size, x + size, y - size);
  c.stroke();
}

/** The triangle in front of a body that shows its heading. */
function nose(c, x, y, radius, heading) {
  const [cos, sin] = [Math.cos(heading), -Math.sin(heading)];
  const [tip, back, half] = [radius * 1.5, radius * 0.7, radius * 0.62];
  c.beginPath();
  c.moveTo(x + cos * tip, y + sin * tip);
  c.lineTo(x + cos * back - sin * half, y + sin * back + cos * half);
  c.lineTo(x + cos * back + sin * half, y + sin * back - cos * half);
  c.closePath();
}

/** The sign of a leader. */
export function star(c, x, y, size, colours) {
  c.beginPath();
  for (let i = 0; i < 10; i++) {
    const radius = i % 2 ? size * 0.45 : size;
    const angle = (i * Math.PI) / 5 - Math.PI / 2;
    c.lineTo(x + Math.cos(angle) * radius, y + Math.sin(angle) * radius);
  }
  c.closePath();
  c.strokeStyle = colours.halo;
  c.lineWidth = 3;
  c.stroke();
  c.fillStyle = colours.text;
  c.fill();
}

/** The sign of a missed deadline. */
export function warning(c, x, y, size, colours) {
  c.beginPath();
  c.moveTo(x, y - size);
  c.lineTo(x + size, y + size * 0.8);
  c.lineTo(x - size, y + size * 0.8);
  c.closePath();
  c.strokeStyle = colours.halo;
  c.lineWidth = 3;
  c.stroke();
  c.fillStyle = ALERT;
  c.fill();
  c.fillStyle = "#fff";
  c.font = `700 ${size * 1.3}px system-ui, sans-serif`;
  c.textAlign = "center";
  c.fillText("!", x, y + size * 0.62);
}
