// What the server has over time, kept in chunks: poses, and entries (frames, trace, log, routes).
//
// A chunk is asked for when its time is shown, once; what arrives live is appended. After a lost connection the chunks
// since then are asked for anew. The number of chunks is bounded: the one that was used longest ago goes.

import { ask } from "./api.js";

const CHUNKS_MAX = 240;
const RETRY_MS = 2000;
const PAGES_MAX = 20; // 5,000 entries each: more in one chunk are left out, and the user is told

class Chunks {
  constructor(seconds, failed) {
    this.seconds = seconds;
    this.failed = failed;
    this.chunks = new Map();
    this.newest = 0;
    this.changed = () => {};
  }

  index(t) {
    return Math.floor(t / this.seconds);
  }

  chunk(index) {
    let chunk = this.chunks.get(index);
    if (!chunk) {
      chunk = { asked: false, loaded: false, used: 0, ...this.empty() };
      this.chunks.set(index, chunk);
      this.forget(index);
    }
    return chunk;
  }

  forget(keep) {
    if (this.chunks.size <= CHUNKS_MAX) return;
    let oldest = null;
    for (const [index, chunk] of this.chunks) {
      if (index !== keep && (oldest === null || chunk.used < this.chunks.get(oldest).used)) oldest = index;
    }
    this.chunks.delete(oldest);
  }

  /** Ask for what is missing between two instants. */
  need(begin, end) {
    for (let index = Math.max(0, this.index(begin)); index <= this.index(end); index++) {
      const chunk = this.chunk(index);
      chunk.used = performance.now();
      if (!chunk.asked) {
        chunk.asked = true;
        this.load(index, chunk);
      }
    }
  }

  async load(index, chunk) {
    try {
      const begin = index * this.seconds;
      await this.fetchInto(chunk, begin, begin + this.seconds);
      chunk.loaded = true;
      this.changed();
    } catch (error) {
      setTimeout(() => (chunk.asked = false), RETRY_MS);
      this.failed(error);
    }
  }

  /** What came in the last moments may be incomplete: ask for it anew when it is shown. */
  doubt(begin = this.newest - this.seconds) {
    for (const [index, chunk] of this.chunks) if (index >= this.index(begin)) chunk.asked = false;
  }
}

const COLUMNS = ["t", "x", "y", "heading"];

export class Poses extends Chunks {
  constructor(failed) {
    super(20, failed);
  }

  empty() {
    return { robots: new Map(), estimates: new Map() };
  }

  async fetchInto(chunk, begin, end) {
    const data = await ask("poses", { begin, end: end + 0.25 });
    const robots = new Map();
    const estimates = new Map();
    for (const [id, own] of Object.entries(data.robots ?? {})) robots.set(Number(id), known(own, data.t));
    for (const [id, own] of Object.entries(data.estimates ?? {})) estimates.set(Number(id), known(own, data.t));
    chunk.robots = joined(robots, chunk.robots);
    chunk.estimates = joined(estimates, chunk.estimates);
  }

  /** A message "poses" of the socket. */
  take(message) {
    const { t } = message;
    this.newest = Math.max(this.newest, t);
    const places = [this.index(t)];
    if (t - this.index(t) * this.seconds < 0.25) places.push(this.index(t) - 1); // to interpolate across the border
    for (const index of places) {
      const chunk = this.chunk(index);
      append(chunk.robots, message.robots, t);
      append(chunk.estimates, message.estimates, t);
    }
  }

  /** Return [x, y, heading] at `t`, or null; `estimated`: where the robot believes to be. */
  at(robot, t, estimated = false) {
    const chunk = this.chunks.get(this.index(t));
    const own = chunk && (estimated ? chunk.estimates : chunk.robots).get(robot);
    if (!own || !own.t.length) return this.before(robot, t, estimated);
    const i = after(own.t, t);
    if (i === 0) return this.before(robot, t, estimated) ?? [own.x[0], own.y[0], own.heading[0]];
    const last = i - 1;
    if (i === own.t.length) return [own.x[last], own.y[last], own.heading[last]];
    const share = (t - own.t[last]) / (own.t[i] - own.t[last] || 1);
    const turned = wrapped(own.heading[i] - own.heading[last]);
    return [
      own.x[last] + share * (own.x[i] - own.x[last]),
      own.y[last] + share * (own.y[i] - own.y[last]),
      own.heading[last] + share * turned,
    ];
  }

  /** The last pose of the chunk before: estimates that do not change are not repeated. */
  before(robot, t, estimated) {
    for (let index = this.index(t) - 1; index >= this.index(t) - 3; index--) {
      const chunk = this.chunks.get(index);
      const own = chunk && (estimated ? chunk.estimates : chunk.robots).get(robot);
      const last = own ? own.t.length - 1 : -1;
      if (last >= 0) return [own.x[last], own.y[last], own.heading[last]];
    }
    return null;
  }

  /** Call `point(x, y)` for the poses of a robot from `begin` to `end`. */
  trail(robot, begin, end, point) {
    for (let index = Math.max(0, this.index(begin)); index <= this.index(end); index++) {
      const own = this.chunks.get(index)?.robots.get(robot);
      if (!own) continue;
      for (let i = after(own.t, begin); i < own.t.length && own.t[i] < end; i++) point(own.x[i], own.y[i]);
    }
  }
}

/** A robot's columns without the samples at which its pose was not known. */
function known(own, times) {
  const t = own.t ?? [...times]; // each robot its own: live samples are appended
  const all = { t, x: own.x, y: own.y, heading: own.heading };
  if (!all.x.includes(null)) return all;
  const keep = all.x.map((x) => x !== null);
  return Object.fromEntries(COLUMNS.map((column) => [column, all[column].filter((_, i) => keep[i])]));
}

function append(into, robots, t) {
  for (const [id, pose] of Object.entries(robots ?? {})) {
    let own = into.get(Number(id));
    if (!own) into.set(Number(id), (own = { t: [], x: [], y: [], heading: [] }));
    const last = own.t.length - 1;
    if (last >= 0 && own.t[last] >= t) continue;
    own.t.push(t);
    own.x.push(pose[0]);
    own.y.push(pose[1]);
    own.heading.push(pose[2]);
  }
}

/** What was asked for, then what has come live since. */
function joined(asked, came) {
  for (const [id, live] of came) {
    const own = asked.get(id);
    if (!own) asked.set(id, live);
    else {
      const from = own.t.length ? after(live.t, own.t[own.t.length - 1]) : 0;
      for (const column of COLUMNS) own[column] = own[column].concat(live[column].slice(from));
    }
  }
  return asked;
}

/** Return the place of the first number greater than `t`. */
function after(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}

function wrapped(angle) {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

export class Entries extends Chunks {
  /** `path` is the route under /api; `timeOf` an entry's instant in seconds; `seconds` the length of a chunk. */
  constructor(path, failed, timeOf = (entry) => entry.t, seconds = 10) {
    super(seconds, failed);
    this.path = path;
    this.timeOf = timeOf;
    this.cut = false;
  }

  empty() {
    return { entries: [] };
  }

  async fetchInto(chunk, begin, end) {
    const found = [];
    const seen = new Set();
    for (let page = 0, from = begin; ; page++) {
      const answer = await ask(this.path, { begin: from, end });
      for (const entry of answer.entries) {
        const key = answer.more || page ? JSON.stringify(entry) : null; // pages overlap in one instant
        if (key !== null && seen.has(key)) continue;
        if (key !== null) seen.add(key);
        if (this.timeOf(entry) < end) found.push(entry);
      }
      if (!answer.more || !answer.entries.length) break;
      if (page >= PAGES_MAX) {
        this.cut = true;
        break;
      }
      from = this.timeOf(answer.entries[answer.entries.length - 1]);
    }
    const last = found.length ? this.timeOf(found[found.length - 1]) : -1;
    chunk.entries = found.concat(chunk.entries.filter((entry) => this.timeOf(entry) > last));
  }

  /** Entries that came over the socket. */
  take(entries) {
    for (const entry of entries) {
      const t = this.timeOf(entry);
      this.newest = Math.max(this.newest, t);
      this.chunk(this.index(Math.max(0, t))).entries.push(entry);
    }
    this.changed();
  }

  /** Return the loaded entries from `begin` to `end`, by time. */
  between(begin, end) {
    const found = [];
    for (let index = Math.max(0, this.index(begin)); index <= this.index(end); index++) {
      for (const entry of this.chunks.get(index)?.entries ?? []) {
        const t = this.timeOf(entry);
        if (t >= begin && t <= end) found.push(entry);
      }
    }
    return found;
  }

  /** Return whether everything between two instants is here. */
  has(begin, end) {
    for (let index = Math.max(0, this.index(begin)); index <= this.index(end); index++) {
      if (!this.chunks.get(index)?.loaded) return false;
    }
    return true;
  }
}
