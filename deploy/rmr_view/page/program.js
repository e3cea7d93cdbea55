// The program with the line that was asked for; the lines of rules that the chosen robot fired last are marked.

import { html, useEffect, useRef } from "./vendor/htm-preact.js";
import { useKeys } from "./store.js";
import { placeOf } from "./trace_text.js";

const TOKEN = /(\/\/.*$)|(\b(?:type|action|sensor|const|include|assert|extern|trigger|priority|random|textual)\b)|(\b[A-Z_][A-Za-z0-9_]*\b)|(-o|:-|[!$?@])/g;

export function ProgramPanel() {
  const { run, place, details } = useKeys("run", "place", "details");
  const marked = useRef(null);
  const scrolled = useRef(null);
  useEffect(() => {
    if (place !== scrolled.current) marked.current?.scrollIntoView({ block: "center" });
    scrolled.current = place;
  });
  if (!run.program?.source) return html`<p class="empty">The run has no source of its program, only byte-code.</p>`;
  const elsewhere = place && place.name !== baseName(run.program.name);
  const fired = new Map();
  for (const one of details?.fired ?? []) {
    const at = placeOf(one.rule);
    if (at && at.name === baseName(run.program.name)) fired.set(at.line, (fired.get(at.line) ?? 0) + 1);
  }
  return html`<div class="program">
    <h3>${baseName(run.program.name)}</h3>
    ${elsewhere ? html`<p class="trouble">Line ${place.line} of ${place.file} is in another file.</p>` : null}
    <pre tabindex="0" aria-label="The program"><code>${run.program.source.split("\n").map((text, i) => {
      const chosen = place && !elsewhere && place.line === i + 1;
      const count = fired.get(i + 1);
      return html`<span class=${chosen ? "line chosen" : "line"} ref=${chosen ? marked : null}
        ><i title=${count ? `fired ${count} times lately by robot ${details.robot}` : null} class=${count ? "fired" : ""}>${i + 1}</i><span>${tinted(text)}</span></span>`;
    })}</code></pre>
  </div>`;
}

function baseName(name) {
  return String(name ?? "program").split("/").pop();
}

/** A line with comments, words of the language and variables told apart. */
function tinted(text) {
  const parts = [];
  let at = 0;
  for (const found of text.matchAll(TOKEN)) {
    if (found.index > at) parts.push(text.slice(at, found.index));
    const kind = found[1] ? "comment" : found[2] ? "word" : found[3] ? "variable" : "sign";
    parts.push(html`<span class=${kind}>${found[0]}</span>`);
    at = found.index + found[0].length;
  }
  parts.push(text.slice(at), "\n");
  return parts;
}
