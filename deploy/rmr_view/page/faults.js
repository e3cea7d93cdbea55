// Faults by button, only where the page may: partition, loss, kill, restart, stall; and what is active.

import { html, useState } from "./vendor/htm-preact.js";
import { token } from "./api.js";
import { Badge, Section } from "./parts.js";
import { clockText, faultBegin, faultEnd, faultText, intervalAt, isGone, stateText } from "./run_facts.js";
import { mayControl, order } from "./session.js";
import { useKeys } from "./store.js";

export function FaultsPanel() {
  const { run, timeline, nowSlow, selected } = useKeys("run", "timeline", "nowSlow", "selected");
  const [seconds, setSeconds] = useState(5);
  const [loss, setLoss] = useState(50);
  const [apart, setApart] = useState([]);
  if (!run.control) return html`<p class="empty">Faults can be caused only in a run that goes on, and only if the page was started with --control.</p>`;
  if (!token) return html`<p class="trouble">The address lacks the token. Open the page by the whole address that was printed.</p>`;
  const active = (timeline?.faults ?? []).filter((fault) => faultBegin(fault) <= nowSlow && nowSlow < faultEnd(fault));
  const kinds = new Map(run.robots.map((robot) => [robot, intervalAt(timeline, robot, nowSlow)?.kind]));
  const dead = run.robots.filter((robot) => isGone(kinds.get(robot)));
  const rest = run.robots.filter((robot) => !apart.includes(robot));
  const toggle = (robot) => setApart(apart.includes(robot) ? apart.filter((one) => one !== robot) : [...apart, robot]);
  const for_s = Number(seconds) || 5;
  return html`<div class="faultpanel">
    <div class=${active.length || dead.length ? "active some" : "active"} role="status">
      <strong>${active.length || dead.length ? "Active now" : "No fault is active"}</strong>
      <ul class="list">
        ${active.map((fault) => html`<li>${faultText(fault)}, since ${clockText(faultBegin(fault))}${Number.isFinite(faultEnd(fault)) ? `, until ${clockText(faultEnd(fault))}` : ""}</li>`)}
        ${dead.map((robot) => html`<li>robot ${robot} ${stateText(kinds.get(robot))}</li>`)}
      </ul>
      <button class="plain" onClick=${() => order({ do: "clear" })}>Clear radio faults</button>
    </div>
    <label class="field">Lasts <input type="number" min="0.1" max="600" step="any" value=${seconds} onInput=${(event) => setSeconds(event.target.value)} /> s</label>
    <${Section} title="Partition">
      <p class="empty">Choose the robots of one side; they and the others do not hear each other.</p>
      <div class="roster">${run.robots.map(
        (robot) => html`<button key=${robot} class="chip" aria-pressed=${apart.includes(robot) ? "true" : "false"} aria-label="robot ${robot} on the other side" onClick=${() => toggle(robot)}><${Badge} robot=${robot} /></button>`,
      )}</div>
      <button class="fault" disabled=${!apart.length || !rest.length} onClick=${() => order({ do: "partition", groups: [apart, rest], for_s })}>
        Partition${apart.length && rest.length ? ` ${apart.join(", ")} | ${rest.length > 8 ? "the others" : rest.join(", ")}` : ""}</button>
    </${Section}>
    <${Section} title="Loss of frames">
      <label class="field"><input type="range" min="1" max="100" value=${loss} aria-label="Share of frames lost, per cent" onInput=${(event) => setLoss(Number(event.target.value))} /> <output>${loss} %</output></label>
      <button class="fault" onClick=${() => order({ do: "loss", loss: loss / 100, for_s })}>Lose ${loss} % of all frames</button>
    </${Section}>
    <${Section} title=${selected === null ? "One robot" : `Robot ${selected}`} note=${selected === null ? "Choose a robot to kill, restart or stall it." : null}>
      <div class="buttons">
        <button class="fault" disabled=${dead.includes(selected)} onClick=${() => order({ do: "kill", robot: selected })}>Kill</button>
        <button class="plain" onClick=${() => order({ do: "restart", robot: selected })}>Restart</button>
        <button class="fault" disabled=${dead.includes(selected)} onClick=${() => order({ do: "stall", robot: selected, for_s })}>Stall for ${for_s} s</button>
      </div>
    </${Section}>
  </div>`;
}

/** A line above the floor that says which faults are active, with a button that ends them. */
export function ActiveFaults() {
  const { timeline, nowSlow } = useKeys("timeline", "nowSlow", "run");
  const active = (timeline?.faults ?? []).filter((fault) => faultBegin(fault) <= nowSlow && nowSlow < faultEnd(fault));
  if (!active.length) return null;
  return html`<div class="faultline" role="status"><b aria-hidden="true">⚡</b> ${active.slice(0, 3).map(faultText).join(" · ")}${active.length > 3 ? ` and ${active.length - 3} more` : ""}
    ${mayControl() ? html`<button class="plain" onClick=${() => order({ do: "clear" })}>Clear</button>` : null}</div>`;
}
