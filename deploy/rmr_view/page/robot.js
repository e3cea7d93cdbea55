// The chosen robot: state, deadline, schedule, goals, facts with `why`, actions, rules fired.

import { html, useState } from "./vendor/htm-preact.js";
import { Badge, Instant, Place, RobotLink, Section } from "./parts.js";
import { clockText, deadlineState, intervalAt, laneOf, leadersAt, schedulesAt, stateText } from "./run_facts.js";
import { Late } from "./late.js";
import { choose, clock, explain, explainMiss, poses } from "./session.js";
import { get, set, useKeys } from "./store.js";
import { Why } from "./why.js";

const STALE_S = 1.5; // while it plays, answers are a moment old

/** The robots of the run, to choose one. */
export function Roster() {
  const { run, selected, timeline, nowSlow } = useKeys("run", "selected", "timeline", "nowSlow");
  return html`<div class=${run.robots.length > 22 ? "roster many" : "roster"} role="listbox" aria-label="Robots">
    ${run.robots.map((robot) => {
      const kind = intervalAt(timeline, robot, nowSlow)?.kind;
      const label = `Robot ${robot}, ${stateText(kind)}`;
      return html`<button key=${robot} role="option" class="chip ${kind ?? "free"}" aria-selected=${robot === selected ? "true" : "false"}
        aria-label=${label} title=${label} onClick=${() => choose(robot === selected ? null : robot)}><${Badge} robot=${robot} small=${run.robots.length > 22} /></button>`;
    })}
  </div>`;
}

export function RobotPanel() {
  const state = useKeys("run", "selected", "details", "detailsError", "timeline", "nowSlow", "why", "late");
  const { selected, details, detailsError } = state;
  if (selected === null) {
    return html`<div class="hint">
      <p>Choose a robot on the floor, in the timeline or by its number.</p>
      <p class="empty">Then this shows what it knew and did at the time shown, and why.</p>
      <${Overview} />
    </div>`;
  }
  return html`<div class="robot">
    <${Head} />
    ${state.late ? html`<${Late} />` : null}
    ${state.why ? html`<${Why} />` : null}
    ${detailsError ? html`<p class="trouble" role="status">${detailsError}</p>` : null}
    ${details?.problem ? html`<p class="trouble" role="status">${sentence(details.problem)}</p>` : null}
    ${details ? html`<div class=${isStale(details, state.nowSlow) ? "mind stale" : "mind"}><${Mind} details=${details} /></div>` : detailsError ? null : html`<p class="empty">Replaying its mind …</p>`}
  </div>`;
}

/** Whether an answer about a robot is of another instant than the one shown. */
function isStale(details, t) {
  return Math.abs(details.t - t) > STALE_S;
}

/** All robots with their deadlines, while none is chosen. */
function Overview() {
  const { run, timeline, nowSlow } = useKeys("run", "timeline", "nowSlow");
  const leaders = leadersAt(timeline, nowSlow);
  return html`<table class="grid">
    <thead><tr><th>Robot</th><th>State</th><th class="num">Deadline</th><th></th></tr></thead>
    <tbody>
      ${run.robots.map((robot) => {
        const deadline = currentDeadline(laneOf(timeline, robot).deadlines, nowSlow);
        const kind = intervalAt(timeline, robot, nowSlow)?.kind;
        return html`<tr key=${robot} class="pick" onClick=${() => choose(robot)}>
          <td><${RobotLink} robot=${robot} /></td>
          <td>${stateText(kind)}${leaders.has(robot) ? html` <span class="tag">★ leads</span>` : null}</td>
          <td class="num">${deadline ? clockText(deadline.deadline_s) : "—"}</td>
          <td class="num"><${Left} deadline=${deadline} t=${nowSlow} /></td>
        </tr>`;
      })}
    </tbody>
  </table>`;
}

function currentDeadline(deadlines, t) {
  const begun = deadlines.filter((one) => one.begin_s <= t);
  return begun.find((one) => deadlineState(one, t) === "open") ?? begun[begun.length - 1] ?? null;
}

function Left({ deadline, t }) {
  if (!deadline) return "—";
  const state = deadlineState(deadline, t);
  if (state === "met") return html`<span class="good">✓ met</span>`;
  const done = deadline.finish_s !== null && deadline.finish_s !== undefined && deadline.finish_s <= t;
  if (state === "missed") return html`<span class="bad">✕ ${((done ? deadline.finish_s : t) - deadline.deadline_s).toFixed(1)} s late</span>`;
  return `${(deadline.deadline_s - t).toFixed(1)} s left`;
}

function Head() {
  const { selected, timeline, nowSlow, details } = get();
  const interval = intervalAt(timeline, selected, nowSlow);
  const deadline = currentDeadline(laneOf(timeline, selected).deadlines, nowSlow);
  const since = interval ? `${stateText(interval.kind)}${interval.event ? ` (${interval.event})` : ""}, since ${clockText(interval.begin_s)}` : "free";
  return html`<header class="robothead">
    <${Badge} robot=${selected} />
    <div>
      <h2>Robot ${selected}${leadersAt(timeline, nowSlow).has(selected) ? html` <span class="tag">★ leads</span>` : null}</h2>
      <p>${since}</p>
      ${details?.progress && !isStale(details, nowSlow) ? html`<p>${details.progress}</p>` : null}
    </div>
    <button class="icon" aria-label="Choose no robot" title="choose no robot (Esc)" onClick=${() => choose(null)}>×</button>
    ${deadline ? html`<${DeadlineBar} robot=${selected} deadline=${deadline} t=${nowSlow} />` : null}
    <${PoseLine} robot=${selected} t=${nowSlow} />
  </header>`;
}

function DeadlineBar({ robot, deadline, t }) {
  const state = deadlineState(deadline, t);
  const all = Math.max(1e-6, deadline.deadline_s - deadline.begin_s);
  const share = Math.min(1, Math.max(0, (Math.min(t, deadline.finish_s ?? t) - deadline.begin_s) / all));
  return html`<div class="deadline ${state}">
    <div class="bar"><span style=${{ width: `${(share * 100).toFixed(1)}%` }}></span></div>
    <p><code>${deadline.job}</code> by ${clockText(deadline.deadline_s)} · <${Left} deadline=${deadline} t=${t} />${state === "missed" ? html` <button class="plain" onClick=${() => explainMiss(robot, deadline)}>why late?</button>` : null}</p>
  </div>`;
}

/** A heading in radians as whole degrees from 0 to 359. */
export function degreesOf(heading) {
  return ((Math.round((heading * 180) / Math.PI) % 360) + 360) % 360;
}

/** Pose and error of the estimate at the time shown, from what is drawn. */
function PoseLine({ robot, t }) {
  const at = poses.at(robot, t);
  if (!at) return null;
  const guess = poses.at(robot, t, true);
  const away = guess ? Math.hypot(guess[0] - at[0], guess[1] - at[1]) * 1000 : null;
  return html`<p class="pose">at (${at[0].toFixed(2)}, ${at[1].toFixed(2)}) m, heading ${degreesOf(at[2])}°${away === null ? "" : `, estimate off by ${away.toFixed(0)} mm`}</p>`;
}

function Mind({ details }) {
  const { goals = {}, facts = [], sensed = [], fired = [], actions = [], queue } = details;
  const open = (goals.open ?? []).map((goal) => asPair(goal));
  const achieved = (goals.achieved ?? []).map((goal) => asPair(goal));
  return html`
    <${Schedules} robot=${details.robot} />
    ${queue ? html`<p class="queue">${queue} ${queue === 1 ? "frame waits" : "frames wait"} in its radio.</p>` : null}
    ${open.length + achieved.length
      ? html`<${Section} title="Goals">
          <ul class="list">
            ${open.map(([goal]) => html`<li><code>${goal}</code> <span class="tag">open</span></li>`)}
            ${achieved.map(([goal, t]) => html`<li><code>${goal}</code> <span class="good">✓</span> <${Instant} t=${t} /></li>`)}
          </ul>
        </${Section}>`
      : null}
    <${Section} title="Facts" count=${facts.length} note=${facts.length ? null : "It holds none."}>
      <ul class="facts">${facts.map((fact) => html`<li key=${factText(fact)}><${Fact} robot=${details.robot} fact=${factText(fact)} t=${details.t} /></li>`)}</ul>
    </${Section}>
    ${sensed?.length
      ? html`<${Section} title="Sensed" count=${sensed.length}>
          <ul class="facts">${sensed.map((fact) => html`<li key=${factText(fact)}><${Fact} robot=${details.robot} fact=${factText(fact)} t=${details.t} /></li>`)}</ul>
        </${Section}>`
      : null}
    <${WhyNot} robot=${details.robot} />
    <${Section} title="Actions" note=${actions.length ? null : "None so far."}>
      <ul class="list timed">${last(actions, 12).map((action) => html`<${Action} action=${action} />`)}</ul>
    </${Section}>
    <${Section} title="Rules fired" note=${fired.length ? null : "None so far."}>
      <ul class="list timed">${last(fired, 15).map((one) => html`<li><${Instant} t=${one.t} digits=${3} /> <${Place} at=${one.rule} /></li>`)}</ul>
    </${Section}>
  `;
}

export function Fact({ robot, fact, t }) {
  const { why } = get();
  const asked = why && why.robot === robot && why.fact === fact;
  return html`<button class="fact" aria-pressed=${asked ? "true" : "false"} title="why does robot ${robot} hold this?"
    onClick=${() => (asked ? set({ why: null }) : explain(robot, fact, t))}><code>${fact}</code><span class="ask">why?</span></button>`;
}

/** A fact that the robot does not hold, and the question why. */
function WhyNot({ robot }) {
  const [fact, setFact] = useState("");
  const { timeline, nowSlow } = get();
  const example = currentDeadline(laneOf(timeline, robot).deadlines, nowSlow)?.job ?? `fact(@${robot})`;
  const submit = (event) => {
    event.preventDefault();
    if (fact.trim()) explain(robot, fact.trim(), Math.round(clock.t * 1000) / 1000, true);
  };
  return html`<form class="whynot" onSubmit=${submit}>
    <label><span class="hidden">A fact that it does not hold</span><input type="search" placeholder=${example} value=${fact} onInput=${(event) => setFact(event.target.value)} /></label>
    <button class="plain" disabled=${!fact.trim()}>why not?</button>
  </form>`;
}

function Action({ action }) {
  const [text, t] = Array.isArray(action) ? [action[1], action[0]] : [action.action ?? action.text, action.t ?? action.begin_s];
  const failed = action.failure ? html` <span class="bad">failed: ${action.failure}</span>` : null;
  const over = action.end_s ? html` <span class="muted">until ${clockText(action.end_s)}</span>` : null;
  return html`<li><${Instant} t=${t} /> <code>${text}</code>${failed}${over}</li>`;
}

function Schedules({ robot }) {
  const { timeline, nowSlow } = get();
  const mine = schedulesAt(timeline, nowSlow).filter((one) => one.order.includes(robot));
  if (!mine.length) return null;
  return html`<${Section} title="Schedule">
    ${mine.map(
      (one) => html`<div class="order" key=${one.event}>
        <div>${one.order.map((other, place) => html`${place ? html`<i>›</i>` : null}<span class=${other === robot ? "mine" : ""}><${RobotLink} robot=${other} /></span>`)}</div>
        <p>${one.event ? html`<code>${one.event}</code> · ` : null}${ordinal(one.order.indexOf(robot) + 1)} of ${one.order.length} · made by robot ${one.leader}, term ${one.term}</p>
      </div>`,
    )}
  </${Section}>`;
}

function factText(fact) {
  return typeof fact === "string" ? fact : fact.fact ?? fact.text ?? JSON.stringify(fact);
}

function sentence(text) {
  const said = text[0].toUpperCase() + text.slice(1);
  return /[.!?]$/.test(said) ? said : `${said}.`;
}

function asPair(goal) {
  if (Array.isArray(goal)) return goal;
  return typeof goal === "string" ? [goal, null] : [goal.goal ?? goal.text, goal.t ?? null];
}

function last(items, count) {
  return items.slice(-count).reverse();
}

function ordinal(n) {
  const tail = n % 100 > 10 && n % 100 < 14 ? "th" : { 1: "st", 2: "nd", 3: "rd" }[n % 10] ?? "th";
  return `${n}${tail}`;
}
