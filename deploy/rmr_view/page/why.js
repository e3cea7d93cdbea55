// `why` as a tree that can be unfolded: the answer of `rmr why --json`.
//
// A node is shown with whatever of these it has: a kind, a text, the robot, an instant, a place in the source; its
// causes are its children. Nodes below depth 2 begin folded.

import { html, useState } from "./vendor/htm-preact.js";
import { Instant, Place, RobotLink } from "./parts.js";
import { get, set } from "./store.js";

const OPEN_DEPTH = 2;
const CHILDREN = ["children", "causes", "because", "from", "premises", "body", "derivations", "rules"];

export function Why() {
  const { why } = get();
  return html`<section class="why" aria-label="Explanation">
    <header><h3>Why <code>${why.fact}</code></h3>
      <button class="icon" aria-label="Close the explanation" title="close" onClick=${() => set({ why: null })}>×</button></header>
    ${why.error ? html`<p class="trouble" role="status">${why.error}</p>` : null}
    ${why.tree ? html`<ul class="tree" role="tree"><${Node} node=${rootOf(why.tree)} depth=${0} /></ul>` : why.error ? null : html`<p class="empty">Replaying …</p>`}
  </section>`;
}

function rootOf(answer) {
  return answer.tree ?? answer.root ?? answer.why ?? answer;
}

function childrenOf(node) {
  for (const key of CHILDREN) if (Array.isArray(node[key]) && node[key].length) return node[key];
  const cause = node.cause ?? node.firing ?? node.event;
  return cause && typeof cause === "object" ? [cause] : [];
}

function Node({ node, depth }) {
  const children = childrenOf(node).map((child) => (typeof child === "object" ? child : { text: String(child) }));
  const [open, setOpen] = useState(depth < OPEN_DEPTH);
  const more = children.length ? html`<button class="twist" aria-label=${open ? "fold" : "unfold"} onClick=${() => setOpen(!open)}>${open ? "▾" : "▸"}</button>` : html`<span class="twist"></span>`;
  return html`<li role="treeitem" aria-expanded=${children.length ? String(open) : null}>
    <div class="node">${more}<${Said} node=${node} />${!open && children.length ? html`<span class="count">${children.length}</span>` : null}</div>
    ${open && children.length ? html`<ul role="group">${children.map((child, i) => html`<${Node} key=${i} node=${child} depth=${depth + 1} />`)}</ul>` : null}
  </li>`;
}

function Said({ node }) {
  const t = node.t ?? node.t_s ?? node.at_s ?? node.begin_s ?? null;
  const place = node.place ?? node.rule ?? null;
  const text = node.fact ?? node.text ?? node.action ?? node.message ?? node.label ?? node.goal ?? null;
  return html`<span class="said">
    ${node.kind ? html`<span class="kind ${node.kind}">${node.kind}</span>` : null}
    ${text ? html`<code>${text}</code>` : null}
    ${node.robot !== undefined && node.robot !== null ? html`<${RobotLink} robot=${node.robot} />` : null}
    ${typeof place === "string" ? html`<${Place} at=${place} />` : null}
    ${t !== null ? html`<${Instant} t=${t} digits=${3} />` : null}
    ${node.note ?? node.why ?? node.reason ? html`<span class="muted">${node.note ?? node.why ?? node.reason}</span>` : null}
  </span>`;
}
