// Why a deadline was missed: the answer of `rmr why RUN --missed --json` for one job.
//
// First the owners of its time with their sums, the largest first, then the intervals in the order of time, without gap
// or overlap. A click on an interval shows its begin.

import { html } from "./vendor/htm-preact.js";
import { Instant } from "./parts.js";
import { clockText } from "./run_facts.js";
import { get, set } from "./store.js";

export function Late() {
  const { late } = get();
  const { delay } = late;
  return html`<section class="why late" aria-label="Why the deadline was missed">
    <header><h3>Why late <code>${late.job}</code></h3>
      <button class="icon" aria-label="Close the explanation" title="close" onClick=${() => set({ late: null })}>×</button></header>
    ${late.error ? html`<p class="trouble" role="status">${late.error}</p>` : null}
    ${delay || late.error ? null : html`<p class="empty">Replaying …</p>`}
    ${delay ? html`<${Delay} delay=${delay} />` : null}
    ${(late.problems ?? []).map((problem) => html`<p class="empty">${problem}</p>`)}
  </section>`;
}

function Delay({ delay }) {
  const all = delay.owners.reduce((sum, one) => sum + one.s, 0);
  return html`
    <p>${clockText(delay.start_s, 3)} to ${clockText(delay.end_ns / 1e9, 3)}, deadline ${clockText(delay.deadline_s, 3)}: <span class="bad">${outcome(delay)}</span></p>
    <table class="grid owners" aria-label="Owners of the time">
      <thead><tr><th class="num">Time</th><th class="num">Share</th><th>Owner</th><th></th></tr></thead>
      <tbody>${delay.owners.map((one) => html`<tr><td class="num">${one.s.toFixed(3)} s</td><td class="num">${all ? Math.round((100 * one.s) / all) : 0} %</td><td>${one.owner}</td><td>${one.words}</td></tr>`)}</tbody>
      <tfoot><tr><td class="num">${all.toFixed(3)} s</td><td></td><td>in all</td><td></td></tr></tfoot>
    </table>
    <details><summary>${delay.intervals.length} intervals in the order of time</summary>
      <ul class="list timed intervals">${delay.intervals.map((one) => html`<li class=${one.after_deadline ? "bad" : ""}><${Instant} t=${one.begin_ns / 1e9} digits=${3} /> ${one.s.toFixed(3)} s ${one.owner}${one.whom.length ? `, robot ${one.whom.join(", ")}` : ""}${one.detail ? html` <span class="muted">${one.detail}</span>` : null}</li>`)}</ul>
    </details>`;
}

function outcome(delay) {
  if (delay.lateness_s === null) return "not finished";
  return `${Math.abs(delay.lateness_s).toFixed(3)} s ${delay.lateness_s > 0 ? "late" : "early"}`;
}
