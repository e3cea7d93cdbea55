// `why` as a tree that can be unfolded: the answer of `rmr why --json`, or of `rmr why --not --json`.
//
// An item (fact, goal, action, message) is shown with the rule that led to it, in other words its cause; what the rule
// took are its children. Where the answer was cut, a button asks for more from that item on. Deep nodes begin folded.

import { html, useState } from "./vendor/htm-preact.js";
import { ask } from "./api.js";
import { Instant, Place, RobotLink } from "./parts.js";
import { get, set } from "./store.js";

const OPEN_DEPTH = 3;
const OPEN_DEPTH_ABSENT = 2;
const MARKS = { satisfied: "✓", missing: "✕", blocked: "✕", false: "✕", held: "✓" };

export function Why() {
  const { why } = get();
  const answer = why.tree;
  const items = answer ? answer.answers ?? answer.absent ?? [] : [];
  return html`<section class="why" aria-label="Explanation">
    <header><h3>${why.negative ? "Why not" : "Why"} <code>${why.fact}</code></h3>
      <button class="icon" aria-label="Close the explanation" title="close" onClick=${() => set({ why: null })}>×</button></header>
    ${why.error ? html`<p class="trouble" role="status">${why.error}</p>` : null}
    ${answer || why.error ? null : html`<p class="empty">Replaying …</p>`}
    ${items.length ? html`<ul class="tree" role="tree">${items.map((item, i) => (answer.answers ? html`<${Item} key=${i} item=${item} depth=${0} why=${why} />` : html`<${Reason} key=${i} item=${item} depth=${0} />`))}</ul>` : null}
    ${[...(answer?.notes ?? []), ...(answer?.problems ?? [])].map((note) => html`<p class="empty">${note}</p>`)}
  </section>`;
}

/** A node of the tree: its line, and its children if it is unfolded. */
function Branch({ children, count, first, more }) {
  const [open, setOpen] = useState(first);
  const [line, ...below] = children;
  return html`<li role="treeitem" aria-expanded=${count ? String(open) : null}>
    <div class="node">
      ${count ? html`<button class="twist" aria-label=${open ? "Fold" : "Unfold"} onClick=${() => setOpen(!open)}>${open ? "▾" : "▸"}</button>` : html`<span class="twist" aria-hidden="true">·</span>`}
      <span class="said">${line}${!open && count ? html`<span class="count">${count} below</span>` : null}</span>
    </div>
    ${count && open ? html`<ul role="group">${below}</ul>` : null}
    ${more ?? null}
  </li>`;
}

function Item({ item, depth, why }) {
  const [asked, setAsked] = useState(null);
  const shown = asked?.item ?? item;
  const unfold = async () => {
    setAsked({ waits: true });
    try {
      const answer = await ask("why", { robot: why.robot, fact: why.fact, t: why.t, more: item.number });
      setAsked({ item: answer.answers[0] });
    } catch (error) {
      setAsked({ error: error.message });
    }
  };
  const more = shown.more
    ? html`<p class="more">${asked?.error ? html`<span class="trouble">${asked.error}</span>` : html`<button class="plain" disabled=${asked?.waits} onClick=${unfold}>${asked?.waits ? "Replaying …" : "Explain further"}</button>`}</p>`
    : null;
  return html`<${Branch} count=${shown.children.length} first=${depth < OPEN_DEPTH} more=${more}>
    <${Said} item=${shown} asker=${why.robot} />
    ${shown.children.map((child, i) => html`<${Item} key=${child.number ?? i} item=${child} depth=${depth + 1} why=${why} />`)}
    ${shown.omitted ? html`<li class="empty">${shown.omitted} more are not shown</li>` : null}
  </${Branch}>`;
}

function Said({ item, asker }) {
  const { rule } = item;
  const at = rule?.file ? `${rule.file}:${rule.line}` : null;
  const words = at ? item.words.replace(/^by rule .*$/, "by rule") : item.words;
  const bound = rule?.conditions?.length ? html`<span class="muted">where ${rule.conditions.join(", ")}</span>` : null;
  return html`<span class="saiditem">
    ${item.robot === asker ? null : html`<${RobotLink} robot=${item.robot} />`}
    <code class="item">${item.text}</code>
    ${item.role && item.role !== "consumed" ? html`<span class="tag">${item.role}</span>` : null}
    <span class="because"><${Instant} t=${item.at_s} digits=${3} /> ${words} ${at ? html`<${Place} at=${at} />` : null} ${bound}
      ${item.shown_elsewhere ? html`<span class="muted">(see above)</span>` : null}</span>
  </span>`;
}

function Reason({ item, depth }) {
  const place = item.place ? `${item.place.file}:${item.place.line}` : null;
  return html`<${Branch} count=${item.children.length} first=${depth < OPEN_DEPTH_ABSENT}>
    <span class="reason ${item.kind}">${MARKS[item.kind] ? html`<b aria-hidden="true">${MARKS[item.kind]}</b> ` : null}${item.text} ${place ? html`<${Place} at=${place} />` : null}</span>
    ${item.children.map((child, i) => html`<${Reason} key=${i} item=${child} depth=${depth + 1} />`)}
  </${Branch}>`;
}
