// Small parts that several panels use.

import { html } from "./vendor/htm-preact.js";
import { inkOn, robotColour } from "./palette.js";
import { choose, seek, showPlace } from "./session.js";
import { clockText } from "./run_facts.js";
import { placeOf, shortPlace } from "./trace_text.js";

/** The round sign of a robot. */
export function Badge({ robot, small }) {
  const colour = robotColour(robot);
  return html`<span class=${small ? "badge small" : "badge"} style=${{ background: colour, color: inkOn(colour) }}>${robot}</span>`;
}

/** A robot that can be chosen by a click. */
export function RobotLink({ robot }) {
  return html`<button class="robotlink" aria-label="Robot ${robot}" title="choose robot ${robot}" onClick=${() => choose(robot)}><${Badge} robot=${robot} small /></button>`;
}

/** An instant; a click shows it. */
export function Instant({ t, digits = 2 }) {
  if (t === null || t === undefined) return html`<span class="time">—</span>`;
  return html`<button class="time" title="show this instant" onClick=${() => seek(t)}>${clockText(t, digits)}</button>`;
}

/** A place in the source; a click shows the program there. */
export function Place({ at }) {
  const place = placeOf(at);
  if (!place) return html`<code>${at}</code>`;
  return html`<button class="place" title="show ${place.file} at line ${place.line}" onClick=${() => showPlace(place)}>${shortPlace(at)}</button>`;
}

export function Section({ title, count, children, note }) {
  return html`<section class="part">
    <h3>${title}${count === undefined ? null : html` <span class="count">${count}</span>`}</h3>
    ${note ? html`<p class="empty">${note}</p>` : children}
  </section>`;
}
