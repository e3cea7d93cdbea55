// One visit of a run: the clock, what is loaded of the run, the socket, and what the user does to them.
//
// Components call the functions below and read the store; nothing else talks to the server.

import { Line, ask, control, token, wanted } from "./api.js";
import { PlaybackClock } from "./clock.js";
import { setRoster } from "./palette.js";
import { deadlineCounts } from "./run_facts.js";
import { Entries, Poses } from "./series.js";
import { get, set, shownTab } from "./store.js";

const TIMELINE_EVERY_MS = 1000;
const DETAILS_EVERY_MS = 500;
const SLOW_EVERY_S = 0.2;
const ROUTE_S = 120; // routes are told when they change: those in force are searched so far back
export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20];

export const clock = new PlaybackClock();
export const poses = new Poses(fail);
export const frames = new Entries("frames", fail, (entry) => entry.start_s ?? entry.t);
export const trace = new Entries("trace", fail);
export const log = new Entries("log", fail);
export const routes = new Entries("routes", fail, (entry) => entry.t, ROUTE_S);
const now = () => performance.now() / 1000;
const SETTLED_S = 2; // lab time by which it is known what there is of a run that goes on
let line = null;
let settled = false;
let timelineAsked = 0;
let timelineTook = 0;
let timelineTimer = null;

/** Show the sentence of an error. */
function fail(error) {
  set({ message: error.message });
}

for (const series of [frames, trace, log, routes]) series.changed = () => set({ revision: get().revision + 1 });

/** Load the run and begin to follow it. Tries again until the server answers. */
export async function start() {
  let run = null;
  for (let wait = 500; run === null; wait = Math.min(8000, wait * 2)) {
    try {
      run = await ask("run");
      set({ message: null });
    } catch (error) {
      fail(error);
      await new Promise((resolve) => setTimeout(resolve, wait));
    }
  }
  setRoster(run.robots);
  document.title = `${run.lab} · RMR`;
  clock.begin = run.begin_s ?? 0;
  clock.end = run.end_s ?? clock.begin;
  clock.t = clock.begin;
  clock.running = Boolean(run.live);
  set({ run, report: run.report ?? null });
  if (wanted.robot !== null && run.robots.includes(wanted.robot)) choose(wanted.robot);
  if (run.live) clock.goLive();
  if (wanted.t !== null) seek(wanted.t);
  else if (!run.live) clock.playing = true;
  await renewTimeline();
  line = new Line(hear, connected);
  document.addEventListener("visibilitychange", () => (clock.wall = null));
}

function connected(connection) {
  if (connection.state === "open") {
    // What came before the socket was open, and after the last answer, is in neither.
    for (const series of [poses, frames, trace, log, routes]) series.doubt();
    if (connection.again) renewRun();
  }
  set({ connection });
}

/** After a lost connection: the same run, or another one. */
async function renewRun() {
  try {
    const run = await ask("run");
    const old = get().run;
    const same = run.lab === old.lab && run.seed === old.seed && run.mode === old.mode && run.robots.join() === old.robots.join();
    if (!same || run.end_s < clock.end - 5) {
      location.reload(); // the server shows another run now
      return;
    }
    clock.end = Math.max(clock.end, run.end_s ?? 0);
    set({ run, message: null });
    renewTimeline();
  } catch (error) {
    fail(error);
  }
}

function hear(message) {
  const type = message.type;
  if (type === "clock") heardClock(message);
  else if (type === "poses") {
    poses.take(message);
    clock.sample(message.t, now());
  } else if (type === "trace") {
    trace.take(message.entries);
    timelineSoon();
  } else if (type === "frames") frames.take(message.entries);
  else if (type === "log") log.take(message.entries);
  else if (type === "routes") routes.take(message.entries);
  else if (type === "lost") ({ trace, frames, log, routes })[message.kind]?.doubt(message.begin_s); // we were too slow
  else if (type === "end") ended(message.report);
}

function heardClock(message) {
  const running = Boolean(message.running);
  const speed = message.speed || 1;
  const { run } = get();
  if (run.live) {
    clock.sample(message.t, now(), { running, speed, end: message.end_s });
    set({ runPaused: !running, runSpeed: speed });
    if (!settled && running && message.t > SETTLED_S) {
      settled = true;
      renewRun();
    }
  } else clock.end = Math.max(clock.end, message.end_s);
}

function ended(report) {
  const { run } = get();
  clock.running = false;
  clock.over = true;
  if (report?.time_s !== undefined) clock.end = Math.max(clock.end, poses.newest);
  set({ report: report ?? {}, sawEnd: run.live, run: { ...run, live: false, control: false }, runPaused: false });
  if (run.live) renewTimeline();
}

// -- what is asked for again and again ----------------------------------------------------------------------

/** Ask for the timeline, soon: at most once a second, and less often where the answer takes long. */
function timelineSoon() {
  if (timelineTimer !== null) return;
  const pause = Math.max(TIMELINE_EVERY_MS, 10 * timelineTook);
  timelineTimer = setTimeout(renewTimeline, Math.max(0, timelineAsked + pause - performance.now()));
}

async function renewTimeline() {
  clearTimeout(timelineTimer);
  timelineTimer = null;
  timelineAsked = performance.now();
  try {
    const known = clock.end;
    const timeline = await ask("timeline");
    markOpen(timeline, known);
    set({ timeline });
  } catch (error) {
    fail(error);
  }
  timelineTook = performance.now() - timelineAsked;
}

/** Intervals and actions that reach to the present, or to the end of the run, hold there; `known` is older than the answer. */
function markOpen(timeline, known) {
  for (const lane of timeline.lanes) for (const one of [...lane.intervals, ...lane.actions]) one.open = one.end_s >= known;
  for (const one of timeline.leaders) if (one.end_s >= known) one.end_s = null;
}

let detailsBusy = false;
let detailsKey = "";
let detailsNext = 0;

/** Ask what the chosen robot knows at the time shown; not again before the answer is there. */
async function renewDetails() {
  const { selected } = get();
  const wall = performance.now();
  if (selected === null || shownTab() !== "robot" || detailsBusy || wall < detailsNext) return;
  const t = Math.round(clock.t * 100) / 100;
  const key = `${selected}@${t}`;
  if (key === detailsKey) return;
  detailsBusy = true;
  detailsKey = key;
  try {
    const details = await ask(`robot/${selected}`, { t });
    if (get().selected === selected) set({ details, detailsError: null });
  } catch (error) {
    if (get().selected === selected) set({ detailsError: error.message });
  }
  detailsBusy = false;
  detailsNext = performance.now() + Math.max(DETAILS_EVERY_MS, 2 * (performance.now() - wall));
}

let stepping = Promise.resolve();
let stepBusy = false;
let stepTried = "";
let stepNext = 0;

/** Show the stop at the time shown, while the panel is open that steps. */
function renewStep() {
  const { selected } = get();
  if (selected === null || shownTab() !== "step" || stepBusy || performance.now() < stepNext) return;
  if (stepTried !== `${selected}@${clock.t}`) step();
}

/** Carry out a command of `rmr replay --step` for the chosen robot, after those before; without one the stop is shown. */
export function step(command = null) {
  if (command) {
    seek(clock.t);
    clock.playing = false;
  }
  stepping = stepping.then(() => carryOut(command));
}

async function carryOut(command) {
  const { selected, breakpoints } = get();
  if (selected === null) return;
  const { t } = clock;
  const begun = performance.now();
  stepBusy = true;
  stepTried = `${selected}@${t}`;
  if (get().step?.shown !== t) await showStop(selected, null, [`to ${t.toFixed(9)}s`], t);
  const at = get().step;
  if (command && at) {
    const broken = at.rules.map(({ rule }) => rule).filter((rule) => command.endsWith("continue") && breakpoints.includes(rule));
    await showStop(selected, at.at, [...broken.map((rule) => `break ${rule}`), command]);
  }
  stepBusy = false;
  stepNext = performance.now() + 2 * (performance.now() - begun);
}

/** Ask where the lines lead from stop `from`; it is shown at `shown`, or the time shown goes along. */
async function showStop(robot, from, lines, shown = null) {
  try {
    const found = await ask("step", { robot, at: from, do: lines.join("\n") });
    if (get().selected !== robot) return;
    if (shown === null && !found.nowhere) seek(found.t);
    set({ step: { ...found, shown: shown ?? clock.t }, stepError: null });
  } catch (error) {
    if (get().selected === robot) set({ stepError: error.message });
  }
}

let slow = -1;
let counted = 0;
let countedFrom = 0;

/** Once per animation frame: advance the clock and load what it will need. Returns the instant to show. */
export function advance(milliseconds) {
  const wall = milliseconds / 1000;
  const t = clock.frame(wall);
  const { layers, run } = get();
  if (!run) return t;
  poses.need(t - 6, t + 2);
  if (layers.links) frames.need(t - 0.5, t + 2);
  if (layers.routes) routes.need(t - ROUTE_S, t + 2);
  counted += 1;
  if (wall - slow >= SLOW_EVERY_S) {
    slow = wall;
    if (wall - countedFrom >= 1) {
      set({ frameRate: counted / (wall - countedFrom) });
      counted = 0;
      countedFrom = wall;
    }
    set({ nowSlow: t, playing: clock.playing, liveView: clock.live, speed: clock.speed });
    renewDetails();
    renewStep();
  }
  return t;
}

/** Return the planned routes at `t`: pairs of robot and points. */
export function routesAt(t) {
  const newest = new Map();
  for (const entry of routes.between(t - ROUTE_S, t)) newest.set(entry.robot, entry.points);
  return newest;
}

export function counts() {
  const { timeline, nowSlow } = get();
  return deadlineCounts(timeline, nowSlow);
}

// -- what the user does -------------------------------------------------------------------------------------

function shown() {
  slow = -1; // texts follow at once
}

export function seek(t) {
  clock.seek(t);
  shown();
}

export function jump(seconds) {
  seek(clock.t + seconds);
}

export function togglePlay() {
  clock.toggle();
  shown();
}

export function goLive() {
  clock.goLive();
  shown();
}

export function setSpeed(speed) {
  clock.speed = speed;
  shown();
}

/** One step faster or slower. */
export function changeSpeed(steps) {
  const at = SPEEDS.indexOf(clock.speed);
  setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, (at < 0 ? 3 : at) + steps))]);
}

export function choose(robot) {
  if (robot === get().selected) return;
  set({ selected: robot, details: null, detailsError: null, why: null, late: null, step: null, stepError: null });
  detailsKey = "";
  detailsNext = 0;
  shown();
}

export function toggleLayer(name) {
  const { layers } = get();
  set({ layers: { ...layers, [name]: !layers[name] } });
}

export function showPlace(place) {
  set({ place, tab: "program" });
}

/** Ask why `robot` has `fact` (or, with `negative`, why it has not) at `t`. */
export async function explain(robot, fact, t, negative = false) {
  const why = { robot, fact, t, negative, tree: null, error: null };
  set({ why, tab: "robot" });
  try {
    const tree = await ask("why", { robot, fact, t, not: negative ? 1 : null });
    if (get().why === why) set({ why: { ...why, tree } });
  } catch (error) {
    if (get().why === why) set({ why: { ...why, error: error.message } });
  }
}

/** Ask what the time of a missed deadline of `robot` went into; `job` is an entry of its lane. */
export async function explainMiss(robot, job) {
  choose(robot);
  const late = { robot, job: job.job, begin_s: job.begin_s, delay: null, problems: [], error: null };
  set({ late, tab: "robot" });
  let found = {};
  try {
    const { delays, problems } = await ask("missed", { robot });
    const of = delays.filter((one) => one.job === job.job);
    const delay = of.find((one) => Math.abs(one.start_s - job.begin_s) < 0.01) ?? of[of.length - 1] ?? null;
    found = { delay, problems, error: delay ? null : "The recording does not say yet that this deadline was missed: ask again in a second." };
  } catch (error) {
    found = { error: error.message };
  }
  if (get().late === late) set({ late: { ...late, ...found } });
}

/** Send an order to the run; an error is shown. Returns whether it was carried out. */
export async function order(body) {
  try {
    await control(body);
    set({ message: null });
    timelineSoon();
    return true;
  } catch (error) {
    fail(error);
    return false;
  }
}

export function mayControl() {
  return Boolean(get().run?.control && token);
}

export function maySteer() {
  const { run } = get();
  return Boolean(run?.live && run.steer && token);
}

export function reconnectNow() {
  line?.hurry();
}
