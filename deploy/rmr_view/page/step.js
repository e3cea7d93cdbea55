// Stepping through the mind of the chosen robot: the stops of `rmr replay --step`, and the page's time goes along.
//
// The server carries out the commands; what is shown here are its lines. Each names rules as FILE:LINE.

import { html, useState } from "./vendor/htm-preact.js";
import { Place, Section } from "./parts.js";
import { Fact } from "./robot.js";
import { step } from "./session.js";
import { set, useKeys } from "./store.js";

const WAYS = [
  ["firing", "next", "J", "K"],
  ["input", "input", "I", "Shift+I"],
  ["breakpoint", "continue", "C", "Shift+C"],
];
const RULE = /(\S+\.rmr:\d+)/;

export function StepPanel() {
  const { selected, step: at, stepError, breakpoints } = useKeys("selected", "step", "stepError", "breakpoints");
  const [where, setWhere] = useState("");
  if (selected === null) return html`<p class="empty">Choose a robot: then its firings and inputs are gone through here.</p>`;
  const field = where.trim();
  const go = (back) => field && step(/^[0-9]/.test(field) ? `to ${field}` : `${back}until ${field}`);
  const tick = (rule) => set({ breakpoints: breakpoints.includes(rule) ? breakpoints.filter((one) => one !== rule) : [...breakpoints, rule] });
  const broken = at?.rules.some(({ rule }) => breakpoints.includes(rule));
  return html`<div class="step">
    ${WAYS.map(([what, command, key, backKey]) => {
      const off = !at || (command === "continue" && !broken);
      return html`<div class="buttons" role="group" aria-label=${what}>
        <button class="plain" aria-label="Previous ${what}" title="previous ${what} (${backKey})" disabled=${off} onClick=${() => step(`back ${command}`)}>←</button>
        <span>${what}</span>
        <button class="plain" aria-label="Next ${what}" title="next ${what} (${key})" disabled=${off} onClick=${() => step(command)}>→</button>
      </div>`;
    })}
    <form class="whynot" onSubmit=${(event) => (event.preventDefault(), go(""))}>
      <button type="button" class="plain" aria-label="Back to it" title="back to where the fact began to hold" disabled=${!field} onClick=${() => go("back ")}>←</button>
      <label><span class="hidden">An instant or a fact</span><input type="search" placeholder="12.3s, or at(@${selected}, _)" value=${where} onInput=${(event) => setWhere(event.target.value)} /></label>
      <button class="plain" aria-label="Go to it" title="go to the instant, or to where the fact begins to hold" disabled=${!field}>→</button>
    </form>
    ${stepError ? html`<p class="trouble" role="status">${stepError}</p>` : null}
    ${at?.nowhere ? html`<p class="trouble" role="status">${at.nowhere}</p>` : null}
    ${at ? html`<${Stop} at=${at} breakpoints=${breakpoints} tick=${tick} />` : stepError ? null : html`<p class="empty">Replaying its mind …</p>`}
  </div>`;
}

function Stop({ at, breakpoints, tick }) {
  return html`
    <p class="empty" role="status">Stop ${at.at + 1} of ${at.stops} · ${at.about}</p>
    ${at.problems.map((problem) => html`<p class="trouble">${problem}</p>`)}
    <${Section} title="This stop"><${Lines} lines=${at.stop} /></${Section}>
    <${Section} title="Agenda"><${Lines} lines=${at.agenda} /></${Section}>
    ${at.passed ? html`<${Section} title="Passed over"><${Lines} lines=${at.passed} /></${Section}>` : null}
    ${at.goals.length ? html`<${Section} title="Open goals"><${Lines} lines=${at.goals} /></${Section}>` : null}
    <${Section} title="Facts" count=${at.facts.length + at.sensed.length}>
      <ul class="facts">${[...at.facts, ...at.sensed].map((fact) => html`<li key=${fact}><${Fact} robot=${at.robot} fact=${fact} t=${at.t} /></li>`)}</ul>
    </${Section}>
    <${Section} title="Breakpoints">
      <ul class="list">${at.rules.map(({ rule, fires }) => html`<li key=${rule}><label><input type="checkbox" aria-label="Breakpoint on ${rule}" checked=${breakpoints.includes(rule)} onChange=${() => tick(rule)} /></label> <${Place} at=${rule} /> <span class="muted">fires ${fires} ${fires === 1 ? "time" : "times"}</span></li>`)}</ul>
    </${Section}>`;
}

/** Lines of the terminal's form; the rules in them lead to the program. */
function Lines({ lines }) {
  return html`<ul class="lines">${lines.map((line) => html`<li><code>${line.split(RULE).map((part, i) => (i % 2 ? html`<${Place} at=${part} />` : part))}</code></li>`)}</ul>`;
}
