"""Explained delays as text and as plain data."""

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from rmr.base.time import Duration, in_seconds
from rmr.why.delay import BY_ROBOT, Delay, DelayStep, Interval, TimeOwner, steps_of
from rmr.why.robot_history import LostDelivery

UNDELIVERED_SHOWN: Final = 3
"""Deliveries that were given up of which the text tells."""


class Share(NamedTuple):
    """All intervals of one owner, for one reason."""

    owner: TimeOwner
    words: str
    duration: Duration
    intervals: int


def shares(delay: Delay) -> list[Share]:
    """Return the time by owner and reason, the largest first; of equal ones the earliest."""
    found: dict[tuple[TimeOwner, int, tuple[int, ...], str], list[Interval]] = {}
    for interval in delay.intervals:
        detail = "" if interval.whom and interval.owner in BY_ROBOT else interval.detail
        found.setdefault((interval.owner, interval.robot, interval.whom, detail), []).append(interval)
    made = [
        Share(group[0].owner, _words(delay, group), sum(each.duration for each in group), len(group))
        for group in found.values()
    ]
    return sorted(made, key=lambda share: -share.duration)


def delay_text(delay: Delay, *, timeline: bool = False) -> str:
    """Return one delay as text with line ends: by owner, or in the order of time."""
    total = delay.end - delay.job.start
    lines = [heading(delay)]
    if timeline:
        lines += [
            f"  {in_seconds(each.begin):9.3f} s  {in_seconds(each.duration):8.3f} s  {each.owner.value:<14}  "
            f"{_words(delay, [each])}{'  (after the deadline)' if each.begin >= delay.job.deadline else ''}"
            for each in delay.intervals
        ]
    else:
        for share in shares(delay):
            percent = round(100 * share.duration / total) if total else 0
            lines.append(
                f"  {in_seconds(share.duration):8.3f} s  {percent:3d} %  {share.owner.value:<14}  {share.words}"
            )
    lines.append(f"  {in_seconds(total):8.3f} s  in all{_after_deadline(delay)}")
    lines += _steps_text(delay)
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _steps_text(delay: Delay) -> list[str]:
    """Return the steps of a job that has several: by when each was due, when it ended, and what its time went into."""
    steps = steps_of(delay)
    if len(steps) < 2:
        return []
    return ["by step:", "        due       began       ended        late", *[_step_text(delay, step) for step in steps]]


def _step_text(delay: Delay, step: DelayStep) -> str:
    late = "-" if step.lateness is None else f"{in_seconds(step.lateness):+.3f} s"
    ended = f"{in_seconds(step.end):.3f} s" if step.ended else "-"
    at = [*["-" if each is None else f"{in_seconds(each):.3f} s" for each in (step.due, step.begun)], ended, late]
    whose = "" if step.robot == delay.robot else f"robot {step.robot}: "
    times = ", ".join(_time(*each) for each in step.owners)
    return f"{''.join(f'{each:>11} ' for each in at)} {whose}{step.text}: {times}"


def _time(owner: TimeOwner, whom: Sequence[int], time: Duration) -> str:
    """Return what somebody waited for, with the other robots, and for how long."""
    return " ".join(filter(None, [owner.value, _others(owner, whom), f"{in_seconds(time):.3f} s"]))


def _others(owner: TimeOwner, whom: Sequence[int]) -> str:
    robots = f"robot{'s' if len(whom) > 1 else ''} {', '.join(map(str, whom))}" if whom else ""
    return f"{_PREPOSITIONS[owner]} {robots}" if whom and owner in _PREPOSITIONS else ""


def heading(delay: Delay) -> str:
    """Return the line that says which job it is, and how it ended."""
    job = delay.job
    return (
        f"{job.name}@{delay.robot}: {job.text} from {in_seconds(job.start):.3f} s, "
        f"deadline {in_seconds(job.deadline):.3f} s, {_outcome(delay)}"
    )


def delays_text(delays: Sequence[Delay], run: str) -> str:
    """Return all missed deadlines of a run, a line each, with the largest owners; `run` is named in the last line."""
    if not delays:
        return "no deadline was missed\n"
    lines = [
        f"{delay.job.name}@{delay.robot}  {_outcome(delay)}: " + ", ".join(_short(share) for share in shares(delay)[:3])
        for delay in delays
    ]
    first = delays[0]
    lines.append(f"for all of one: rmr why {run} --missed {first.job.name}@{first.robot}")
    return "\n".join(lines) + "\n"


def undelivered_text(lost: Sequence[LostDelivery]) -> str:
    """Return lines on deliveries that were given up, which no job may wait for any more: the first ones."""
    lines = [
        f"not delivered: {each.text} from robot {each.robot} to robot {each.destination}, "
        f"given up {in_seconds(each.at):.3f} s: {each.why}"
        for each in lost[:UNDELIVERED_SHOWN]
    ]
    if len(lost) > UNDELIVERED_SHOWN:
        lines.append(f"and {len(lost) - UNDELIVERED_SHOWN} more not delivered; --json has all")
    return "".join(f"{line}\n" for line in lines)


def undelivered_data(lost: Sequence[LostDelivery]) -> list[dict[str, Any]]:
    """Return deliveries that were given up as plain data; times in seconds, and exactly in nanoseconds."""
    return [
        {
            "at_s": in_seconds(each.at),
            "at_ns": each.at,
            "robot": each.robot,
            "destination": each.destination,
            "text": each.text,
            "why": each.why,
        }
        for each in lost
    ]


def delay_data(delay: Delay) -> dict[str, Any]:
    """Return one delay as plain data; times in seconds, and exactly in nanoseconds."""
    job = delay.job
    return {
        "name": job.name,
        "robot": delay.robot,
        "job": job.text,
        "start_s": in_seconds(job.start),
        "deadline_s": in_seconds(job.deadline),
        "finish_s": None if job.finish is None else in_seconds(job.finish),
        "lateness_s": None if delay.lateness is None else in_seconds(delay.lateness),
        "missed": job.missed or job.finish is None,
        "cause": job.cause,
        "start_ns": job.start,
        "deadline_ns": job.deadline,
        "end_ns": delay.end,
        "owners": [
            {
                "owner": share.owner.value,
                "words": share.words,
                "s": in_seconds(share.duration),
                "ns": share.duration,
                "intervals": share.intervals,
            }
            for share in shares(delay)
        ],
        "steps": [
            {
                "begin_ns": step.begin,
                "begun_ns": step.begun,
                "end_ns": step.end,
                "due_ns": step.due,
                "late_ns": step.lateness,
                "s": in_seconds(step.duration),
                "robot": step.robot,
                "action": step.text if step.is_action else None,
                "owners": [
                    {"owner": owner.value, "whom": list(whom), "s": in_seconds(time), "ns": time}
                    for owner, whom, time in step.owners
                ],
            }
            for step in steps_of(delay)
        ],
        "intervals": [
            {
                "begin_ns": each.begin,
                "end_ns": each.end,
                "s": in_seconds(each.duration),
                "owner": each.owner.value,
                "robot": each.robot,
                "whom": list(each.whom),
                "detail": each.detail,
                "after_deadline": each.begin >= job.deadline,
            }
            for each in delay.intervals
        ],
    }


def _outcome(delay: Delay) -> str:
    if delay.lateness is None:
        return "not finished"
    late = f"{in_seconds(abs(delay.lateness)):.3f} s {'late' if delay.lateness > 0 else 'early'}"
    if delay.job.cause == "network":
        return f"finished in time, the news of it {late}"
    return f"finished {late}"


def _after_deadline(delay: Delay) -> str:
    after = delay.end - delay.job.deadline
    return f", {in_seconds(after):.3f} s of it after the deadline" if after > 0 else ""


def _short(share: Share) -> str:
    """Return a share on one line with others."""
    words = share.words.split(" (")[0] if share.owner in BY_ROBOT else ""
    return " ".join(filter(None, [share.owner.value, words, f"{in_seconds(share.duration):.3f} s"]))


def _words(delay: Delay, intervals: Sequence[Interval]) -> str:
    """Return the reason of intervals that have one owner and the same robots."""
    first = intervals[0]
    parts = [rule for each in _details(intervals) for rule in (each.split(", ") if first.whom else [each])]
    details = ", ".join(dict.fromkeys(parts))
    whose = "" if first.robot in (delay.robot, 0) else f"robot {first.robot}: "
    if not first.whom:
        return whose + details
    others = _others(first.owner, first.whom)
    if not others:
        return f"{whose}{details}"
    return f"{whose}{others}" + (f" ({details})" if details else "")


def _details(intervals: Sequence[Interval]) -> Iterator[str]:
    return (each.detail for each in intervals if each.detail)


_PREPOSITIONS: Final = {
    TimeOwner.TURN: "behind",
    TimeOwner.STANDING: "for",
    TimeOwner.QUEUE: "behind",
    TimeOwner.OUTSIDE: "from",
    TimeOwner.RADIO_QUEUE: "to",
    TimeOwner.CHANNEL_ACCESS: "to",
    TimeOwner.REPEATS: "to",
    TimeOwner.LATE_TICK: "from",
}
