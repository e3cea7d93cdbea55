// The page: header, floor, transport, timeline and the panel with its tabs; one animation loop draws both canvases.

import { html, render, useEffect, useRef, useState } from "./vendor/htm-preact.js";
import { ActiveFaults, FaultsPanel } from "./faults.js";
import { Floor } from "./floor.js";
import { Help, listen } from "./keyboard.js";
import { LogPanel } from "./logs.js";
import { isDark, onTheme, toggleTheme } from "./palette.js";
import { ProgramPanel } from "./program.js";
import { RadioPanel } from "./radio.js";
import { RobotPanel, Roster } from "./robot.js";
import { clockText, intervalAt, leadersAt, stateText } from "./run_facts.js";
import { advance, choose, clock, counts, frames, poses, reconnectNow, routesAt, seek, start, toggleLayer, explainMiss } from "./session.js";
import { StepPanel } from "./step.js";
import { get, set, shownTab, subscribe, useKeys } from "./store.js";
import { GUTTER, Timeline } from "./timeline.js";
import { Steering, Transport, hand } from "./transport.js";

const LAYERS = [
  ["trails", "Trails"],
  ["routes", "Routes"],
  ["views", "Views"],
  ["links", "Frames"],
  ["estimates", "Estimates"],
  ["areas", "Areas"],
];
const TABS = [
  ["robot", "Robot", RobotPanel],
  ["step", "Step", StepPanel],
  ["radio", "Radio", RadioPanel],
  ["log", "Log", LogPanel],
  ["program", "Program", ProgramPanel],
  ["faults", "Faults", FaultsPanel],
];

let floor = null;
let timeline = null;
let shownAt = 0;

/** What the canvases read: the store, the clock and what is loaded. */
const scene = {
  get run() {
    return get().run;
  },
  get timeline() {
    return get().timeline;
  },
  get selected() {
    return get().selected;
  },
  get layers() {
    return get().layers;
  },
  get begin() {
    return clock.begin;
  },
  get end() {
    return clock.end;
  },
  get moving() {
    return clock.playing || clock.live;
  },
  get t() {
    return shownAt;
  },
  poses,
  frames: (begin, end) => frames.between(begin, end),
  routes: routesAt,
  leaders: (t) => leadersAt(get().timeline, t),
};

function animate(milliseconds) {
  requestAnimationFrame(animate);
  shownAt = advance(milliseconds);
  floor?.draw();
  timeline?.draw();
  hand.follow(shownAt);
}

function Header() {
  const { run, connection, report, liveView } = useKeys("run", "connection", "report", "liveView", "runPaused", "nowSlow", "timeline");
  const [, redraw] = useState(0);
  useEffect(() => onTheme(() => redraw((n) => n + 1)), []);
  const { met, missed, open } = counts();
  return html`<header class="top">
    <img src="static/icon.svg" alt="" width="22" height="22" />
    <h1>${run.lab}</h1>
    <span class="facts-of-run">${run.mode === "simulated" ? "simulated" : run.mode}${run.seed === null || run.seed === undefined ? "" : ` · seed ${run.seed}`} · ${run.robots.length} robots</span>
    <${Status} run=${run} connection=${connection} report=${report} liveView=${liveView} />
    <span class="grow"></span>
    ${met + missed + open
      ? html`<span class="tally" title="deadlines at the time shown"><span class="label">Deadlines</span> <span class="good">✓ ${met} met</span> <span class=${missed ? "bad" : "muted"}>✕ ${missed} missed</span> <span class="muted">${open} open</span></span>`
      : null}
    <button class="icon" aria-label=${isDark() ? "Light colours" : "Dark colours"} title="light or dark (T)" onClick=${toggleTheme}>${isDark() ? "☀" : "☾"}</button>
    <button class="icon" aria-label="Help" title="keys (?)" onClick=${() => set({ help: true })}>?</button>
  </header>`;
}

function Status({ run, connection, report }) {
  if (connection.state === "lost") return html`<span class="state lost">disconnected</span>`;
  if (run.live) return html`<span class="state live"><i></i>${get().runPaused ? "paused" : "running"}</span>`;
  if (report?.finished === undefined) return html`<span class="state">recording</span>`;
  const text = report.finished ? `finished after ${clockText(report.time_s)}` : `not finished after ${clockText(report.time_s)}`;
  return html`<span class=${report.finished ? "state" : "state lost"} title="the run is over">${text}</span>`;
}

/** Sentences about the connection, errors and problems of the recording. */
function Notices() {
  const { connection, message, run, report } = useKeys("connection", "message", "run", "report", "sawEnd");
  const [hidden, hide] = useState([]);
  const notes = [];
  if (connection.state === "lost") notes.push(html`<${Lost} key="lost" connection=${connection} />`);
  if (message && connection.state !== "lost") {
    notes.push(html`<div class="notice bad" role="alert" key="message"><span>${message}</span><button class="icon" aria-label="Dismiss" onClick=${() => set({ message: null })}>×</button></div>`);
  }
  if (report && get().sawEnd && !hidden.includes("report")) {
    notes.push(html`<div class="notice" role="status" key="over"><span>${overText(report)}</span><button class="icon" aria-label="Dismiss" onClick=${() => hide([...hidden, "report"])}>×</button></div>`);
  }
  for (const problem of run.problems ?? []) {
    if (!hidden.includes(problem)) notes.push(html`<div class="notice" role="status" key=${problem}><span>${problem}</span><button class="icon" aria-label="Dismiss" onClick=${() => hide([...hidden, problem])}>×</button></div>`);
  }
  return html`<div class="notices">${notes}</div>`;
}

function overText(report) {
  if (report.finished === undefined) return "The run is over.";
  const ended = report.finished ? `The run is over: all robots finished after ${clockText(report.time_s)}.` : `The run is over after ${clockText(report.time_s)}; not all robots finished.`;
  const { met, missed } = report.deadlines ?? {};
  return met + missed ? `${ended} ${met} of ${met + missed} deadlines were met.` : ended;
}

function Lost({ connection }) {
  const [, redraw] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => redraw((n) => n + 1), 250);
    return () => clearInterval(timer);
  }, []);
  const left = Math.max(0, connection.retryAt - performance.now() / 1000);
  const when = left > 0.5 ? `in ${Math.ceil(left)} s` : "now";
  return html`<div class="notice bad" role="status"><span>The connection to the server is lost; trying again ${when}. What is loaded can still be looked at.</span><button class="plain" onClick=${reconnectNow}>Try now</button></div>`;
}

function FloorView() {
  const canvas = useRef(null);
  const tip = useRef(null);
  const { layers, run } = useKeys("layers", "run");
  useEffect(() => {
    floor = new Floor(canvas.current, scene, {
      choose: (robot) => choose(robot === get().selected ? null : robot),
      hover: (robot, x, y) => {
        canvas.current.style.cursor = robot === null ? "grab" : "pointer";
        showTip(tip.current, robot === null ? null : robotTip(robot), x, y);
      },
    });
    return () => (floor = null);
  }, []);
  return html`<div class="floor">
    <canvas ref=${canvas} tabindex="0" role="application" aria-roledescription="map" aria-label="Floor of ${run.lab} with ${run.robots.length} robots. Arrow keys pan, plus and minus zoom, digits choose a robot."></canvas>
    <${ActiveFaults} />
    <div class="layers" role="group" aria-label="Layers">
      ${LAYERS.map(([name, label]) => html`<button key=${name} aria-pressed=${String(layers[name])} onClick=${() => toggleLayer(name)}>${label}</button>`)}
    </div>
    <div class="zoom" role="group" aria-label="Zoom of the floor">
      <button aria-label="Zoom in" title="zoom in (+)" onClick=${() => floor.zoom(1.3)}>+</button>
      <button aria-label="Zoom out" title="zoom out (−)" onClick=${() => floor.zoom(1 / 1.3)}>−</button>
      <button aria-label="Show the whole floor" title="show all (F)" onClick=${() => floor.fit()}>⤢</button>
    </div>
    <div class="tip" role="tooltip" ref=${tip} hidden></div>
  </div>`;
}

function robotTip(robot) {
  const interval = intervalAt(get().timeline, robot, shownAt);
  return [`Robot ${robot}`, stateText(interval?.kind) + (interval?.event ? `, ${interval.event}` : "")];
}

function showTip(tip, lines, x, y) {
  tip.hidden = lines === null;
  if (lines === null) return;
  tip.replaceChildren(...lines.map((text) => Object.assign(document.createElement("div"), { textContent: text })));
  const box = tip.parentElement.getBoundingClientRect();
  tip.style.left = `${Math.max(4, Math.min(x + 14, box.width - tip.offsetWidth - 6))}px`;
  tip.style.top = `${Math.max(4, y + 18 + tip.offsetHeight > box.height ? y - tip.offsetHeight - 10 : y + 18)}px`;
}

function TimelineView() {
  const canvas = useRef(null);
  const box = useRef(null);
  const tip = useRef(null);
  const { run } = useKeys("run");
  useEffect(() => {
    timeline = new Timeline(canvas.current, scene, {
      seek,
      choose,
      explain: explainMiss,
      hover: (lines, x, y) => {
        canvas.current.style.cursor = x > GUTTER ? "crosshair" : "pointer";
        showTip(tip.current, lines, x, y - box.current.scrollTop);
      },
    });
    // A lane that is chosen elsewhere comes into view.
    let chosen = null;
    const forget = subscribe(() => {
      const { selected } = get();
      if (selected !== chosen) box.current.scrollTop = timeline.scrollFor(selected, box.current);
      chosen = selected;
    });
    const size = () => (canvas.current.style.height = `${timeline.height(Math.max(170, innerHeight * 0.3))}px`);
    size();
    addEventListener("resize", size);
    return () => {
      removeEventListener("resize", size);
      forget();
      timeline = null;
    };
  }, []);
  return html`<div class="timeline">
    <div class="scroll" ref=${box}><canvas ref=${canvas} tabindex="0" role="application" aria-roledescription="timeline"
      aria-label="Timeline with a lane for each of ${run.robots.length} robots. A click shows that instant; plus and minus zoom."></canvas></div>
    <div class="zoom" role="group" aria-label="Zoom of the timeline">
      <button aria-label="Zoom the timeline in" title="zoom in" onClick=${() => timeline.zoom(1.6)}>+</button>
      <button aria-label="Zoom the timeline out" title="zoom out" onClick=${() => timeline.zoom(1 / 1.6)}>−</button>
      <button aria-label="Show the whole run" title="whole run (F)" onClick=${() => timeline.whole()}>⤢</button>
    </div>
    <div class="tip" role="tooltip" ref=${tip} hidden></div>
  </div>`;
}

function Panel() {
  const { run } = useKeys("tab", "run");
  const tabs = TABS.filter(([name]) => name !== "faults" || run.control);
  const chosen = tabs.find(([name]) => name === shownTab());
  const step = (event) => {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!move) return;
    event.stopPropagation();
    const next = tabs[(tabs.indexOf(chosen) + move + tabs.length) % tabs.length][0];
    set({ tab: next });
    event.currentTarget.querySelector(`[data-tab=${next}]`).focus();
  };
  return html`<aside class="panel">
    <${Roster} />
    <div class="tabs" role="tablist" aria-label="Panels" onKeyDown=${step}>
      ${tabs.map(
        ([name, label]) =>
          html`<button key=${name} data-tab=${name} id="tab-${name}" role="tab" aria-selected=${String(name === chosen[0])} aria-controls="panel" tabindex=${name === chosen[0] ? 0 : -1} onClick=${() => set({ tab: name })}>${label}</button>`,
      )}
    </div>
    <div class="body" id="panel" role="tabpanel" aria-labelledby="tab-${chosen[0]}"><${chosen[2]} key=${chosen[0]} /></div>
  </aside>`;
}

function Page() {
  const { run, message } = useKeys("run", "message");
  if (!run) return html`<p class="empty loading" role="status">${message ? `${message} Trying again …` : "Loading the run …"}</p>`;
  return html`<div class="page">
    <${Header} />
    <${Notices} />
    <main>
      <${FloorView} />
      <div class="bars"><${Transport} /><${Steering} /></div>
      <${TimelineView} />
      <${Panel} />
    </main>
    <${Help} />
  </div>`;
}

// For tests: what was drawn last.
window.__rmr = {
  get frames() {
    return floor?.frames ?? 0;
  },
  get robots() {
    return Object.fromEntries(floor?.drawn ?? []);
  },
  get view() {
    return floor?.view ? { ...floor.view } : null;
  },
  get window() {
    return timeline ? timeline.span() : null;
  },
  get t() {
    return shownAt;
  },
  get end() {
    return clock.end;
  },
  get live() {
    return clock.live;
  },
  get playing() {
    return clock.playing;
  },
  get state() {
    return get();
  },
  get routes() {
    return Object.fromEntries(routesAt(shownAt));
  },
  get estimates() {
    return Object.fromEntries(get().run.robots.map((robot) => [robot, poses.at(robot, shownAt, true)]));
  },
  get links() {
    return floor.linked;
  },
  get missed() {
    return counts().missed;
  },
  place(robot) {
    const pose = floor.drawn.get(robot);
    return pose ? [floor.px(pose.x), floor.py(pose.y)] : null;
  },
  timeAt(t) {
    return timeline.px(t);
  },
};

const root = document.getElementById("app");
root.replaceChildren();
render(html`<${Page} />`, root);
listen(
  () => floor,
  () => timeline,
);
requestAnimationFrame(animate);
start();
