// Logs: the trace of the robots and the log lines of the processes up to the time shown, the newest first.

import { html, useState } from "./vendor/htm-preact.js";
import { Instant, Place, RobotLink } from "./parts.js";
import { log, trace } from "./session.js";
import { useKeys } from "./store.js";
import { LEVELS, logLine, traceLine } from "./trace_text.js";

const BACK_S = 60;
const LINES_MAX = 250;

export function LogPanel() {
  const { run, nowSlow } = useKeys("run", "nowSlow", "revision");
  const [level, setLevel] = useState("info");
  const [robot, setRobot] = useState("");
  const [text, setText] = useState("");
  const begin = Math.max(0, nowSlow - BACK_S);
  trace.need(begin, nowSlow);
  log.need(begin, nowSlow);
  const least = LEVELS.indexOf(level);
  const needle = text.trim().toLowerCase();
  const lines = [...trace.between(begin, nowSlow).map(traceLine), ...log.between(begin, nowSlow).map(logLine)]
    .filter((one) => LEVELS.indexOf(one.level) >= least)
    .filter((one) => robot === "" || one.robot === Number(robot))
    .filter((one) => !needle || `${one.text} ${one.name ?? ""}`.toLowerCase().includes(needle))
    .sort((a, b) => b.t - a.t);
  return html`<div class="logs">
    <div class="filters">
      <label>Robot <select value=${robot} onChange=${(event) => setRobot(event.target.value)}>
        <option value="">all</option>${run.robots.map((one) => html`<option value=${one}>${one}</option>`)}
      </select></label>
      <label>Level <select value=${level} onChange=${(event) => setLevel(event.target.value)}>
        ${LEVELS.map((one) => html`<option value=${one}>${one}${one === "error" ? "" : " and up"}</option>`)}
      </select></label>
      <label class="grow"><span class="hidden">Text</span><input type="search" placeholder="text" value=${text} onInput=${(event) => setText(event.target.value)} /></label>
    </div>
    ${lines.length ? null : html`<p class="empty">Nothing in the ${BACK_S} s up to now.</p>`}
    <ol class="loglines">
      ${lines.slice(0, LINES_MAX).map(
        (one) => html`<li class=${one.level}>
          <${Instant} t=${one.t} digits=${3} />
          ${one.robot === null || !run.robots.includes(one.robot) ? html`<span class="process">${one.name || "run"}</span>` : html`<${RobotLink} robot=${one.robot} />`}
          <span class="text">${one.level === "debug" || one.level === "info" ? null : html`<b class="level">${one.level}</b> `}${one.text}${one.place ? html` <${Place} at=${`${one.place.file}:${one.place.line}`} />` : null}</span>
        </li>`,
      )}
    </ol>
    ${lines.length > LINES_MAX ? html`<p class="empty">${lines.length - LINES_MAX} older lines are not shown.</p>` : null}
  </div>`;
}
