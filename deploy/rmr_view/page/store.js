// The state that components share: one plain object, replaced on every change, and who wants to hear of it.
//
// The playback time is not in it: that changes in every animation frame and belongs to the clock. `nowSlow` is a copy
// of it for texts, renewed a few times a second.

import { useEffect, useReducer, useRef } from "./vendor/htm-preact.js";

let state = {
  run: null, // the answer of /api/run
  timeline: null, // the answer of /api/timeline
  selected: null, // id of the chosen robot
  details: null, // the answer of /api/robot/ID
  detailsError: null,
  tab: "robot",
  why: null, // {robot, fact, t, tree, error, negative}
  late: null, // {robot, job, begin_s, delay, problems, error}: the missed deadline that is explained
  step: null, // the answer of /api/step, and the instant for which it is `shown`
  stepError: null,
  breakpoints: [], // rules, as FILE:LINE
  place: null, // {name, line}: the place in the source that the program tab shows
  connection: { state: "connecting" },
  message: null, // a sentence about an error, shown until it is dismissed
  report: null, // the report of a run that is over
  sawEnd: false, // whether it ended while the page looked on
  help: false,
  nowSlow: 0,
  frameRate: 0,
  revision: 0, // grows with every batch of frames, trace or log that has come
  playing: false,
  liveView: false, // whether the page follows the run
  speed: 1,
  runSpeed: 1, // of a simulated run
  runPaused: false,
  layers: { trails: true, routes: true, views: true, links: true, estimates: false, areas: true },
};

const listeners = new Set();

export function get() {
  return state;
}

/** The tab that is shown: without control, as at the end of a run, there are no faults to choose. */
export function shownTab() {
  return state.tab === "faults" && !state.run?.control ? "robot" : state.tab;
}

export function set(changes) {
  const changed = Object.keys(changes).some((key) => state[key] !== changes[key]);
  if (!changed) return;
  state = { ...state, ...changes };
  listeners.forEach((listener) => listener());
}

export function subscribe(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** A component's view of the state: it is drawn again when one of `keys` changes. */
export function useKeys(...keys) {
  const [, redraw] = useReducer((n) => n + 1, 0);
  const seen = useRef(null);
  seen.current = state;
  useEffect(
    () =>
      subscribe(() => {
        if (keys.some((key) => seen.current[key] !== state[key])) redraw();
      }),
    [],
  );
  return state;
}
