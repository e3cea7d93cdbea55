// Keys, and the help that lists them. Keys do nothing while a text or a choice has the focus.

import { html, useEffect, useRef } from "./vendor/htm-preact.js";
import { toggleTheme } from "./palette.js";
import { changeSpeed, choose, clock, goLive, jump, seek, step, toggleLayer, togglePlay } from "./session.js";
import { get, set, useKeys } from "./store.js";

const DIGITS_MS = 700; // digits that follow each other within this are one number

const HELP = [
  ["Space", "play or pause"],
  ["← →", "0.5 s back or on; with Shift 5 s"],
  [", .", "one tick of 1/60 s back or on"],
  ["Home End", "begin or end of the run"],
  ["L", "follow the run (live)"],
  ["[ ]", "play slower or faster"],
  ["0 – 9", "choose a robot by its number"],
  ["N P", "choose the next or the previous robot"],
  ["J K", "next or previous firing of the chosen robot"],
  ["I C", "its next input; next firing of a rule with a breakpoint; with Shift back"],
  ["Esc", "choose no robot; close this"],
  ["+ −", "zoom the floor, or the timeline while it has the focus"],
  ["Arrows", "pan the floor while it has the focus"],
  ["F", "show the whole floor and the whole run"],
  ["E V R G", "estimates, views, routes, trails on or off"],
  ["T", "light or dark"],
  ["?", "this help"],
];

let digits = "";
let digitsAt = 0;

function digit(key) {
  const wall = performance.now();
  digits = wall - digitsAt < DIGITS_MS ? digits + key : key;
  digitsAt = wall;
  const robots = get().run.robots;
  const long = Number(digits);
  if (robots.includes(long)) choose(long);
  else if (robots.includes(Number(key))) {
    digits = key;
    choose(Number(key));
  }
}

function neighbour(step) {
  const { robots } = get().run;
  const at = robots.indexOf(get().selected);
  choose(robots[(Math.max(at, step > 0 ? -1 : 0) + step + robots.length) % robots.length]);
}

/** Listen for keys; `floor` and `timeline` are zoomed and panned by them. */
export function listen(floor, timeline) {
  const acts = {
    " ": togglePlay,
    ".": () => jump(1 / 60),
    ",": () => jump(-1 / 60),
    Home: () => seek(clock.begin),
    End: () => seek(clock.end),
    l: () => get().run.live && goLive(),
    "[": () => changeSpeed(-1),
    "]": () => changeSpeed(1),
    n: () => neighbour(1),
    p: () => neighbour(-1),
    f: () => {
      floor().fit();
      timeline().whole();
    },
    e: () => toggleLayer("estimates"),
    v: () => toggleLayer("views"),
    r: () => toggleLayer("routes"),
    g: () => toggleLayer("trails"),
    t: toggleTheme,
    j: () => stepBy("next"),
    k: () => stepBy("back next"),
    i: () => stepBy("input"),
    I: () => stepBy("back input"),
    c: () => stepBy("continue"),
    C: () => stepBy("back continue"),
    "?": () => set({ help: !get().help }),
    Escape: () => (get().help ? set({ help: false }) : choose(null)),
    "+": () => zoomed().zoom(1.25),
    "=": () => zoomed().zoom(1.25),
    "-": () => zoomed().zoom(0.8),
  };
  const zoomed = () => (document.activeElement === timeline()?.canvas ? timeline() : floor());
  const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !get().run) return;
    const focus = event.target;
    const typing = focus.matches("input:not([type=range], [type=checkbox]), select, textarea");
    if (typing && event.key !== "Escape") return;
    if (focus.matches("button, summary, [type=checkbox]") && (event.key === " " || event.key === "Enter")) return;
    if (focus.matches("input[type=range]") && /^(Arrow|Home|End|Page)/.test(event.key) && !focus.matches(".slider")) return;
    if (/^[0-9]$/.test(event.key)) digit(event.key);
    else if (arrows[event.key]) {
      if (!arrow(event, arrows[event.key], floor())) return;
    } else {
      const act = acts[event.key] ?? acts[event.key.toLowerCase()];
      if (!act) return;
      act();
    }
    event.preventDefault();
  });
}

function arrow(event, [dx, dy], floor) {
  if (document.activeElement === floor?.canvas) floor.pan(dx * 40, dy * 40);
  else if (dx) jump(-dx * (event.shiftKey ? 5 : 0.5));
  else return false; // up and down scroll
  return true;
}

function stepBy(command) {
  set({ tab: "step" });
  step(command);
}

export function Help() {
  const { help } = useKeys("help");
  const dialog = useRef(null);
  useEffect(() => {
    if (help && !dialog.current.open) dialog.current.showModal();
    if (!help && dialog.current.open) {
      dialog.current.close();
      // Chromium takes the focus from a hidden button only when it draws next: a key before that would press it.
      if (dialog.current.contains(document.activeElement)) document.activeElement.blur();
    }
  });
  return html`<dialog class="help" ref=${dialog} aria-label="Keys" onClose=${() => set({ help: false })} onClick=${(event) => event.target === dialog.current && set({ help: false })}>
    <header><h2>Keys</h2><button class="icon" aria-label="Close" onClick=${() => set({ help: false })}>×</button></header>
    <dl>${HELP.map(([keys, what]) => html`<div><dt>${keys.split(" ").map((key) => html`<kbd>${key}</kbd>`)}</dt><dd>${what}</dd></div>`)}</dl>
    <h2>Signs</h2>
    <dl class="signs">
      <div><dt>★</dt><dd>leads the schedule</dd></div>
      <div><dt class="bad">▲ ✕</dt><dd>missed its deadline; the red bar is the lateness</dd></div>
      <div><dt>▽ ●</dt><dd>deadline, and when it was met</dd></div>
      <div><dt><i class="lane asking"></i></dt><dd>asks for a turn</dd></div>
      <div><dt><i class="lane waiting"></i></dt><dd>waits for its turn</dd></div>
      <div><dt><i class="lane claiming"></i></dt><dd>claims its turn</dd></div>
      <div><dt><i class="lane inside"></i></dt><dd>is inside</dd></div>
      <div><dt><i class="lane action"></i></dt><dd>drives or does what the bar names, outside of turns</dd></div>
      <div><dt><i class="lane stalled"></i></dt><dd>is stalled: its process does not run</dd></div>
      <div><dt><i class="lane dead"></i></dt><dd>is dead</dd></div>
      <div><dt><i class="lane stopped"></i></dt><dd>was stopped</dd></div>
    </dl>
  </dialog>`;
}
