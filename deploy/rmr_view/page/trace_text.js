// Entries of the trace and of the logs as lines with a level.

import { clockText } from "./run_facts.js";

export const LEVELS = ["debug", "info", "warning", "error"];

const LEVEL_OF = {
  deadline_missed: "error",
  raised: "error",
  expression_failed: "warning",
  bound_reached: "warning",
  restless: "warning",
  repeats: "warning",
  undelivered: "warning",
  malformed: "warning",
  other_program: "warning",
  slot_lost: "warning",
  fault: "warning",
  stands: "info",
  fired: "debug",
  inserted: "debug",
  removed: "debug",
  sent: "debug",
  repeated: "debug",
  delivered: "debug",
  received: "debug",
  slotted: "debug",
  scheduled: "debug",
};

const FOXGLOVE = { 0: "info", 1: "debug", 2: "info", 3: "warning", 4: "error", 5: "error" };

const TEXT = {
  fired: (e) => `rule ${shortPlace(e.rule)} fired`,
  expression_failed: (e) => `an expression has no value (${e.where}): ${e.reason}`,
  inserted: (e) => `+ ${e.fact}`,
  removed: (e) => `− ${e.fact}`,
  achieved: (e) => `goal achieved: ${e.goal}`,
  finished: () => "holds the finish fact",
  action: (e) => `begins ${e.action}`,
  action_ended: (e) => (e.failure ? `${e.action} failed: ${e.failure}` : `${e.action} is over`),
  raised: (e) => `${e.action} raised: ${[].concat(e.traceback).at(-1)}`,
  said: (e) => `says “${e.text}”`,
  light: (e) => `light ${e.colour}`,
  at: (e) => `arrived at ${e.area}`,
  job_started: (e) => `deadline of ${e.job}: ${clockText(e.deadline_s)}`,
  job_finished: (e) => `finished ${e.job}`,
  deadline_missed: (e) => `missed the deadline of ${e.job}`,
  sent: (e) => `sends ${e.fact} to ${e.destination}`,
  repeated: (e) => `sends ${e.fact} to ${e.destination} again`,
  delivered: (e) => `${e.destination} has acknowledged ${e.fact}`,
  undelivered: (e) => `gave up sending ${e.fact} to ${e.destination}: ${e.why}`,
  received: (e) => `received ${e.fact} from ${e.source}`,
  asks: () => "asks for a turn",
  slotted: (e) => `has slot ${e.rank}: ${clockText(e.start_s)} to ${clockText(e.end_s)}`,
  slot_lost: (e) => `lost its slot of ${e.event}`,
  entered: (e) => `enters ${e.event}${e.cautious ? ", cautiously" : ""}`,
  left: (e) => `leaves ${e.event}`,
  scheduled: (e) => `schedule of ${e.leader}, term ${e.term}: ${e.order.join(", ")}`,
  leads: (e) => `leads, term ${e.term}`,
  fault: (e) => `fault: ${e.fault}`,
};

/** An entry of the trace as {t, robot, level, text, place}. */
export function traceLine(entry) {
  const text = TEXT[entry.what]?.(entry) ?? otherText(entry);
  const place = entry.what === "fired" ? placeOf(entry.rule) : null;
  return { t: entry.t, robot: entry.robot, level: LEVEL_OF[entry.what] ?? "info", text, place };
}

function otherText(entry) {
  const fields = Object.entries(entry).filter(([key]) => !["t", "robot", "what"].includes(key));
  return [entry.what, ...fields.map(([key, value]) => `${key} ${typeof value === "object" ? JSON.stringify(value) : value}`)].join(", ");
}

/** A line of a log as the same: robot from the process's name where it has one. */
export function logLine(entry) {
  const name = entry.name ?? entry.process ?? "";
  const robot = entry.robot ?? (/robots?[-/ ](\d+)$/.exec(name)?.[1] ?? null);
  const level = typeof entry.level === "number" ? FOXGLOVE[entry.level] ?? "info" : String(entry.level ?? "info").toLowerCase();
  const known = level === "fatal" || level === "critical" ? "error" : level === "warn" ? "warning" : level;
  const text = entry.message ?? entry.text ?? otherText(entry);
  return { t: entry.t, robot: robot === null ? null : Number(robot), name, level: LEVELS.includes(known) ? known : "info", text, place: null };
}

/** "some/folder/corridor.rmr:12" as {file, name, line}, or null where it is no place. */
export function placeOf(text) {
  const found = /^(.*?)([^/]+):(\d+)(?::\d+)?$/.exec(text ?? "");
  return found ? { file: found[1] + found[2], name: found[2], line: Number(found[3]) } : null;
}

export function shortPlace(text) {
  const place = placeOf(text);
  return place ? `${place.name}:${place.line}` : String(text);
}
