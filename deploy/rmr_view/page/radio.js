// The radio: frames sent, repeated and lost over time, the queue (uPlot), counters per robot, the last frames.
//
// All of it is computed from the frames of a window of time around the instant shown. A frame waits in its sender's
// queue from `asked_s` to `start_s` of its first transmission.

import { html, useEffect, useRef } from "./vendor/htm-preact.js";
import { ALERT, isDark, onTheme, theme } from "./palette.js";
import { Instant, RobotLink, Section } from "./parts.js";
import { clock, frames, seek } from "./session.js";
import { useKeys } from "./store.js";

const WINDOW_S = 60;
const BINS = 60;
const LAST = 25;

/** The window that is shown: the whole run if it is short, else the minute up to shortly after `t`. */
function windowAt(t) {
  const all = clock.end - clock.begin;
  if (all <= WINDOW_S) return [clock.begin, Math.max(clock.end, clock.begin + 1)];
  const end = Math.min(clock.end, Math.max(clock.begin + WINDOW_S, Math.ceil(t / 5) * 5 + 5));
  return [end - WINDOW_S, end];
}

function isLost(frame) {
  return frame.outcome === "no_ack" || frame.outcome === "access_failure";
}

function binned(found, begin, end) {
  const wide = (end - begin) / BINS;
  const x = Array.from({ length: BINS }, (_, i) => begin + (i + 0.5) * wide);
  const [sent, repeated, lost, queued] = [0, 1, 2, 3].map(() => new Array(BINS).fill(0));
  const bin = (t) => Math.min(BINS - 1, Math.max(0, Math.floor((t - begin) / wide)));
  for (const frame of found) {
    sent[bin(frame.start_s)] += 1 / wide;
    if (frame.attempt) repeated[bin(frame.start_s)] += 1 / wide;
    if (isLost(frame)) lost[bin(frame.start_s)] += 1 / wide;
    if (frame.attempt || frame.asked_s === undefined || frame.asked_s === null) continue;
    // The mean number of frames that wait: each counts for the share of the bin during which it waits.
    for (let i = bin(frame.asked_s); i <= bin(frame.start_s); i++) {
      const overlap = Math.min(frame.start_s, begin + (i + 1) * wide) - Math.max(frame.asked_s, begin + i * wide);
      queued[i] += Math.max(0, overlap) / wide;
    }
  }
  return { traffic: [x, sent, repeated, lost], queue: [x, queued] };
}

export function RadioPanel() {
  const { run, nowSlow, selected } = useKeys("run", "nowSlow", "revision", "selected");
  const [begin, end] = windowAt(nowSlow);
  frames.need(begin, end);
  const found = frames.between(begin, end);
  const data = binned(found, begin, end);
  // Frames of different robots arrive out of order.
  const until = found.filter((frame) => frame.start_s <= nowSlow).sort((a, b) => a.start_s - b.start_s);
  const totals = summed(run.robots, until);
  return html`<div class="radio">
    <${Section} title="Frames a second">
      <${Chart} data=${data.traffic} series=${TRAFFIC} t=${nowSlow} label="Frames sent, repeated and lost a second" />
    </${Section}>
    <${Section} title="Waiting to be sent">
      <${Chart} data=${data.queue} series=${QUEUE} t=${nowSlow} label="Mean number of frames that wait in all robots" height=${84} />
    </${Section}>
    <${Section} title="By robot" >
      <${Counters} totals=${totals} selected=${selected} />
      <p class="empty">From ${begin.toFixed(0)} s to ${nowSlow.toFixed(1)} s${frames.has(begin, end) ? "" : ", still loading"}${frames.cut ? "; more frames than can be shown were left out" : ""}.</p>
    </${Section}>
    <${Section} title="Last frames" note=${until.length ? null : "None so far."}>
      <${LastFrames} found=${until} selected=${selected} />
    </${Section}>
  </div>`;
}

function summed(robots, found) {
  const totals = new Map(robots.map((robot) => [robot, { robot, sent: 0, repeated: 0, lost: 0, octets: 0 }]));
  for (const frame of found) {
    const own = totals.get(frame.source);
    if (!own) continue;
    own.sent += 1;
    own.octets += frame.octets ?? 0;
    if (frame.attempt) own.repeated += 1;
    if (isLost(frame)) own.lost += 1;
  }
  return [...totals.values()];
}

function Counters({ totals, selected }) {
  const most = Math.max(1, ...totals.map((own) => own.sent));
  return html`<table class="grid">
    <thead><tr><th>Robot</th><th class="num">Sent</th><th class="wide"><span class="hidden">share</span></th><th class="num">Repeats</th><th class="num">Lost</th><th class="num">Octets</th></tr></thead>
    <tbody>${totals.map(
      (own) => html`<tr key=${own.robot} class=${own.robot === selected ? "chosen" : ""}>
        <td><${RobotLink} robot=${own.robot} /></td><td class="num">${own.sent}</td>
        <td class="wide"><span class="meter" style=${{ width: `${(100 * own.sent) / most}%` }}></span></td>
        <td class="num">${own.repeated}</td><td class=${own.lost ? "num bad" : "num"}>${own.lost ? `✕ ${own.lost}` : "0"}</td><td class="num">${own.octets}</td>
      </tr>`,
    )}</tbody>
  </table>`;
}

function LastFrames({ found, selected }) {
  const own = selected === null ? found : found.filter((frame) => frame.source === selected || frame.destination === selected);
  return html`<table class="grid">
    <thead><tr><th>At</th><th>From</th><th>To</th><th>Kind</th><th class="num">Octets</th><th>Outcome</th></tr></thead>
    <tbody>${own.slice(-LAST).reverse().map(
      (frame) => html`<tr key=${`${frame.source}/${frame.start_s}`}>
        <td><${Instant} t=${frame.start_s} digits=${3} /></td>
        <td><${RobotLink} robot=${frame.source} /></td>
        <td>${frame.destination === null ? "all" : html`<${RobotLink} robot=${frame.destination} />`}</td>
        <td>${frame.kind}</td><td class="num">${frame.octets}</td><td>${outcome(frame)}</td>
      </tr>`,
    )}</tbody>
  </table>`;
}

function outcome(frame) {
  const again = frame.attempt ? html` <span class="tag">repeat ${frame.attempt}</span>` : null;
  const words = { ok: "acknowledged", broadcast: "sent to all", no_ack: "no answer", access_failure: "channel busy" };
  const text = words[frame.outcome] ?? frame.outcome ?? "repeated";
  return html`<span class=${isLost(frame) ? "bad" : ""}>${isLost(frame) ? "✕ " : ""}${text}</span>${again}`;
}

const TRAFFIC = [
  { label: "sent", colour: "#0072B2", dark: "#56B4E9", fill: true },
  { label: "repeats", colour: "#E69F00", dash: [6, 3] },
  { label: "lost", colour: ALERT, dash: [2, 2] },
];
const QUEUE = [{ label: "frames", colour: "#009E73", fill: true }];

/** A chart of uPlot over lab time; a click seeks. */
function Chart({ data, series, t, label, height = 130 }) {
  const box = useRef(null);
  const chart = useRef(null);
  const playhead = useRef(t);
  playhead.current = t;
  useEffect(() => {
    const make = () => {
      chart.current?.destroy();
      chart.current = new uPlot(options(series, box.current.clientWidth, height, playhead), data, box.current);
      chart.current.over.addEventListener("click", (event) => {
        const at = event.clientX - chart.current.over.getBoundingClientRect().left;
        seek(chart.current.posToVal(at, "x"));
      });
    };
    make();
    const forget = onTheme(make);
    const watch = new ResizeObserver(() => chart.current.setSize({ width: Math.max(120, box.current.clientWidth), height }));
    watch.observe(box.current);
    return () => {
      forget();
      watch.disconnect();
      chart.current.destroy();
    };
  }, []);
  useEffect(() => chart.current?.setData(data));
  return html`<div class="chart" role="img" aria-label=${label} ref=${box}></div>`;
}

function options(series, width, height, playhead) {
  const colours = theme();
  const axis = { stroke: colours.muted, grid: { stroke: colours.line, width: 1 }, ticks: { stroke: colours.line, width: 1, size: 4 }, font: "11px system-ui" };
  return {
    width: Math.max(120, width),
    height,
    legend: { show: series.length > 1, live: false },
    cursor: { y: false, points: { show: false }, drag: { x: false, y: false } },
    scales: { x: { time: false, range: (_, low, high) => windowAt(playhead.current) }, y: { range: (_, low, high) => [0, Math.max(1, high * 1.1)] } },
    axes: [
      { ...axis, size: 26, values: (_, marks) => marks.map((mark) => `${mark} s`) },
      { ...axis, size: 38 },
    ],
    series: [
      {},
      ...series.map((one) => ({
        label: one.label,
        stroke: (isDark() && one.dark) || one.colour,
        width: 1.5,
        dash: one.dash,
        fill: one.fill ? `${(isDark() && one.dark) || one.colour}26` : undefined,
        points: { show: false },
        paths: uPlot.paths.stepped({ align: 1 }),
      })),
    ],
    hooks: { draw: [(chart) => drawPlayhead(chart, playhead.current, colours)] },
  };
}

function drawPlayhead(chart, t, colours) {
  const x = Math.round(chart.valToPos(t, "x", true)) + 0.5;
  const { left, top, width, height } = chart.bbox;
  if (x < left || x > left + width) return;
  chart.ctx.save();
  chart.ctx.strokeStyle = colours.accent;
  chart.ctx.lineWidth = 1.5 * devicePixelRatio;
  chart.ctx.setLineDash([]);
  chart.ctx.beginPath();
  chart.ctx.moveTo(x, top);
  chart.ctx.lineTo(x, top + height);
  chart.ctx.stroke();
  chart.ctx.restore();
}
