// What follows from the timeline: a robot's state at an instant, its deadlines, faults and schedules in words.

const STATES = {
  asking: "asks for a turn",
  waiting: "waits for its turn",
  claiming: "claims its turn",
  inside: "inside",
  stalled: "stalled",
  dead: "killed",
  stopped: "stopped",
};

let indexed = null;
let lanes = new Map();

/** Return the lane of `robot`, or an empty one. */
export function laneOf(timeline, robot) {
  if (indexed !== timeline) {
    indexed = timeline;
    lanes = new Map((timeline?.lanes ?? []).map((lane) => [lane.robot, lane]));
  }
  return lanes.get(robot) ?? { robot, intervals: [], deadlines: [] };
}

/** Return the interval of `robot` at `t`, or null: {kind, begin_s, end_s, event}. */
export function intervalAt(timeline, robot, t) {
  const { intervals } = laneOf(timeline, robot);
  for (let i = intervals.length - 1; i >= 0; i--) {
    const one = intervals[i];
    if (one.begin_s <= t) return t < one.end_s || one.open ? one : null;
  }
  return null;
}

/** Whether a robot has no process during an interval of `kind`. */
export function isGone(kind) {
  return kind === "dead" || kind === "stopped";
}

export function stateText(kind) {
  return STATES[kind] ?? "free";
}

/** How a deadline stands at `t`: "open", "met" or "missed". */
export function deadlineState(deadline, t) {
  if (t < deadline.begin_s) return "later";
  const done = deadline.finish_s !== null && deadline.finish_s !== undefined && deadline.finish_s <= t;
  if (done && deadline.finish_s <= deadline.deadline_s) return "met";
  if (t > deadline.deadline_s || (done && deadline.met === false)) return "missed";
  return done ? "met" : "open";
}

/** Return the number of deadlines that are open, met and missed at `t`. */
export function deadlineCounts(timeline, t) {
  const counts = { open: 0, met: 0, missed: 0, later: 0 };
  for (const lane of timeline?.lanes ?? []) for (const one of lane.deadlines) counts[deadlineState(one, t)] += 1;
  return counts;
}

export function hasMissed(timeline, robot, t) {
  return laneOf(timeline, robot).deadlines.some((one) => deadlineState(one, t) === "missed");
}

/** Return the ids of the robots that lead at `t`. */
export function leadersAt(timeline, t) {
  const found = new Set();
  for (const one of timeline?.leaders ?? []) if (one.begin_s <= t && t < (one.end_s ?? Infinity)) found.add(one.robot);
  return found;
}

/** Return the newest schedule of each event at `t`. */
export function schedulesAt(timeline, t) {
  const newest = new Map();
  for (const one of timeline?.schedules ?? []) if (one.t_s <= t) newest.set(one.event ?? "", one);
  const all = [...newest.values()];
  // The trace may name the event of a schedule only later: a newer one with a name replaces it.
  return all.filter((one) => one.event || !all.some((other) => other.event && other.t_s >= one.t_s));
}

export function faultBegin(fault) {
  return fault.from ?? fault.at ?? fault.at_s ?? fault.begin_s ?? 0;
}

/** Return the end of a fault; Infinity if it has none, its begin if it is over at once. */
export function faultEnd(fault) {
  const end = fault.to ?? fault.until ?? fault.end_s;
  if (end !== undefined && end !== null) return end;
  return "kill" in fault || "restart" in fault || "fault" in fault || "at" in fault ? faultBegin(fault) : Infinity;
}

/** A fault in a few words: "loss 50 %", "partition 1, 2 | 3", "kill 3". */
export function faultText(fault) {
  if (fault.partition) return `partition ${fault.partition.map((group) => group.join(", ")).join(fault.one_way ? " to " : " | ")}`;
  if (fault.fault) return `robot ${fault.robot} ${fault.fault}`;
  const link = fault.link ? ` ${fault.link.join(fault.one_way ? " to " : " and ")}` : "";
  if (fault.cut) return `cut${link}`;
  if (fault.loss !== undefined) return `loss ${Math.round(fault.loss * 100)} %${link}`;
  if (fault.attenuation_db !== undefined) return `attenuation ${fault.attenuation_db} dB${link}`;
  const what = ["kill", "stop", "die", "restart", "stall", "slow", "outage", "mute", "deaf"].find((key) => key in fault);
  return what ? `${what} ${fault[what]}` : "fault";
}

/** Seconds as text: 12.34 s, or 1:02:03.4 where it is long. */
export function clockText(t, digits = 1) {
  if (!Number.isFinite(t)) return "—";
  if (Math.abs(t) < 600) return `${t.toFixed(digits)} s`;
  const minutes = Math.floor(t / 60);
  const seconds = (t - minutes * 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
  return minutes < 60 ? `${minutes}:${seconds}` : `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${seconds}`;
}
