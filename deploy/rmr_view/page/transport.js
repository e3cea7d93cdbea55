// Play and pause, the clock, the slider, speed, live; for a simulated run its own pause, step and speed.

import { html, useEffect, useRef } from "./vendor/htm-preact.js";
import { clockText } from "./run_facts.js";
import { SPEEDS, clock, goLive, maySteer, order, seek, setSpeed, togglePlay } from "./session.js";
import { useKeys } from "./store.js";

const RUN_SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 25, 100];

/** The parts of the bar that follow the clock in every frame; `follow` is set while the bar is shown. */
export const hand = { follow: () => {} };

export function Transport() {
  const { run, playing, liveView, speed } = useKeys("run", "playing", "liveView", "speed", "runPaused", "report");
  const slider = useRef(null);
  const text = useRef(null);
  const end = useRef(null);
  useEffect(() => {
    let dragged = false;
    slider.current.addEventListener("pointerdown", () => (dragged = true));
    slider.current.addEventListener("pointerup", () => (dragged = false));
    slider.current.addEventListener("pointercancel", () => (dragged = false));
    hand.follow = (t) => {
      const { begin } = clock;
      const last = Math.max(clock.end, begin + 0.001);
      slider.current.min = begin;
      slider.current.max = last;
      if (!dragged) slider.current.value = t;
      slider.current.style.setProperty("--done", `${(100 * (t - begin)) / (last - begin)}%`);
      slider.current.setAttribute("aria-valuetext", clockText(t));
      text.current.textContent = clockText(t, 2);
      end.current.textContent = clockText(last);
    };
    return () => (hand.follow = () => {});
  }, []);
  const moving = playing || liveView;
  return html`<div class="transport" role="group" aria-label="Playback">
    <button class="play" aria-label=${moving ? "Pause" : "Play"} title="${moving ? "pause" : "play"} (space)" onClick=${togglePlay}>
      <svg viewBox="0 0 24 24" aria-hidden="true">${moving ? html`<path d="M7 5h3.5v14H7zM13.5 5H17v14h-3.5z" />` : html`<path d="M8 5l11 7-11 7z" />`}</svg>
    </button>
    <span class="clock"><span ref=${text}></span><small> / <span ref=${end}></span></small></span>
    <input class="slider" type="range" step="any" min="0" max="1" ref=${slider} aria-label="Time" onInput=${(event) => seek(Number(event.target.value))} />
    <label class="speed"><span class="hidden">Playback speed</span><select value=${speed} disabled=${liveView} title="playback speed ([ and ])" onChange=${(event) => setSpeed(Number(event.target.value))}>
      ${SPEEDS.map((one) => html`<option value=${one}>${one}×</option>`)}
    </select></label>
    ${run.live ? html`<button class=${liveView ? "live on" : "live"} aria-pressed=${String(liveView)} title="follow the run (L)" onClick=${goLive}><i></i>Live</button>` : null}
  </div>`;
}

/** Pause, step and speed of a simulated run itself. */
export function Steering() {
  const { run, runPaused, runSpeed } = useKeys("run", "runPaused", "runSpeed");
  if (!run.live || !maySteer()) return null;
  const near = RUN_SPEEDS.includes(runSpeed) ? RUN_SPEEDS : [...RUN_SPEEDS, runSpeed].sort((a, b) => a - b);
  return html`<div class="steering" role="group" aria-label="Simulation">
    <span>Simulation</span>
    <button class="plain" onClick=${() => order({ do: runPaused ? "resume" : "pause" })}>${runPaused ? "Resume" : "Pause"}</button>
    <button class="plain" title="advance by one tick of 1/60 s, and pause" onClick=${() => order({ do: "step" })}>Step</button>
    <label>Speed <select value=${runSpeed} onChange=${(event) => order({ do: "speed", speed: Number(event.target.value) })}>
      ${near.map((one) => html`<option value=${one}>${one}×</option>`)}
    </select></label>
  </div>`;
}
