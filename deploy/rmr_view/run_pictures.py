"""The four pictures of a run: trajectories, turns, lateness, radio load; each is the text of an SVG.

Each function takes the data of a run and returns its picture; `PICTURES` names them as `rmr plot RUN` writes them.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate
from typing import Any, Final

from rmr_view.run_data import RunData, thinned
from rmr_view.svg_picture import (
    FLOOR_STYLE,
    KIND_COLOURS,
    LABEL_STYLE,
    LEFT,
    WIDTH,
    FloorDrawing,
    Scale,
    SvgPicture,
    deadline_path,
    element,
    label_class,
    legend,
    number,
    robot_class,
    star_path,
    time_axis,
    value_axis,
)

RIGHT: Final = 30.0
LANE: Final = 26.0
"""Height of one robot's lane."""
JOBS_MAX: Final = 60
"""Jobs that the picture of lateness shows; of more, the latest ones."""
STYLE: Final = (
    LABEL_STYLE
    + FLOOR_STYLE
    + """\
.trail { fill: none; stroke-width: 2; stroke-linejoin: round; stroke-linecap: round }
.start { fill: none; stroke-width: 1.5 }
.bar { stroke-width: 0.8 }
.stalled { fill: url(#hatch) }
.dead { fill: url(#cross) }
.stopped { fill: none; stroke-dasharray: 3 3 }
.band { fill: #D55E00; fill-opacity: 0.13 }
.zero { stroke-width: 1.5 }
"""
)
_HATCHES = (
    '<defs><pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
    '<path class="mid line" d="M0 0v6" stroke-width="3"/></pattern>'
    '<pattern id="cross" width="7" height="7" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
    '<path class="edge line" d="M0 0v7M0 0h7" stroke-width="1.6"/></pattern></defs>'
)


def _picture(height: float, title: str) -> SvgPicture:
    picture = SvgPicture(WIDTH, height, title, STYLE)
    picture.words(20, 26, title, "title")
    return picture


# -- trajectories --------------------------------------------------------------------------------------------------


def trajectories(data: RunData) -> str:
    """Return the ways of all robots on the floor: a ring where each began, its id where it ended."""
    drawing = FloorDrawing(data.floor, 20, 44, WIDTH - 40, 1200)
    picture = _picture(drawing.height_px + 64, f"{data.title}: trajectories")
    drawing.draw(picture)
    shown = [(index, data.tracks[robot]) for index, robot in enumerate(data.robots) if data.tracks.get(robot)]
    for index, track in shown:
        # Detail of trajectories: what is further off is not left out.
        kept = thinned(track.t, (track.x, track.y), 0.004)
        points = drawing.points([(track.x[k], track.y[k]) for k in kept])
        picture.add("polyline", f"trail {robot_class(index, stroke=True)}", points=points)
        x = drawing.x(track.x[0])
        y = drawing.y(track.y[0])
        picture.add("circle", f"start {robot_class(index, stroke=True)}", cx=x, cy=y, r=drawing.radius_px)
    for index, track in shown:
        body(picture, drawing.x(track.x[-1]), drawing.y(track.y[-1]), drawing.radius_px, index, data.robots[index])
    return picture.text()


def body(picture: SvgPicture, x: float, y: float, radius: float, index: int, robot: int) -> None:
    """Draw the body of a robot with its id."""
    picture.add("circle", f"bar edge {robot_class(index)}", cx=x, cy=y, r=radius)
    size = min(13.0, max(7.0, radius * (1.2 if robot < 10 else 0.9)))
    picture.add(
        "text", f"middle {label_class(index)}", str(robot), x=x, y=y + 0.36 * size, style=f"font-size:{size:g}px"
    )


# -- turns -----------------------------------------------------------------------------------------------------------


def turns(data: RunData) -> str:
    """Return a lane for each robot: what it did about its turn, its deadlines, and what it missed."""
    lanes = data.timeline["lanes"]
    top = 66.0
    bottom = top + LANE * len(lanes)
    picture = _picture(bottom + 70, f"{data.title}: turns and deadlines")
    picture.parts.append(_HATCHES)
    scale = Scale(0.0, time_end(data), LEFT, WIDTH - RIGHT)
    _faults(picture, data.timeline["faults"], scale, top, bottom)
    time_axis(picture, scale, top, bottom)
    _leaders(picture, data.timeline["leaders"], scale, top)
    for index, lane in enumerate(lanes):
        _lane(picture, lane, scale, top + LANE * index, index)
    kinds = dict.fromkeys(each["kind"] for lane in lanes for each in lane["intervals"])
    known = [(kind, kind) for kind in (*KIND_COLOURS, "stalled", "dead", "stopped") if kind in kinds]
    entries = [*known, ("deadline", "deadline"), ("done", "done"), ("miss", "deadline missed")]
    legend(picture, LEFT, bottom + 56, entries)
    return picture.text()


def time_end(data: RunData) -> float:
    """Return the end of the axis of time: of the recording, or the last deadline if that is later and not far."""
    last = max((job["deadline_s"] for job in data.jobs), default=0.0)
    return max(data.end_s, min(last, 2.5 * data.end_s), 1e-3) * 1.02


def _lane(picture: SvgPicture, lane: Mapping[str, Any], scale: Scale, top: float, index: int) -> None:
    middle = top + LANE / 2
    picture.add("circle", f"bar edge {robot_class(index)}", cx=26, cy=middle, r=6)
    picture.words(LEFT - 10, middle + 4, f"robot {lane['robot']}", "end small")
    picture.add("line", "faint", x1=LEFT, y1=top, x2=WIDTH - RIGHT, y2=top)
    for each in lane["intervals"]:
        x = scale(each["begin_s"])
        width = max(0.8, scale(each["end_s"]) - x)
        picture.add("rect", f"bar edge {each['kind']}", x=x, y=top + 6, width=width, height=LANE - 12)
    for job in lane["deadlines"]:
        _deadline(picture, job, scale, middle)


def _deadline(picture: SvgPicture, job: Mapping[str, Any], scale: Scale, middle: float) -> None:
    if job["deadline_s"] <= scale.high:
        x = scale(job["deadline_s"])
        if job["met"] is False:
            picture.cross(x, middle)
        else:
            picture.add("path", "ink", d=deadline_path(x, middle))
    if job["finish_s"] is not None:
        x = scale(job["finish_s"])
        picture.add("circle", "missed" if job["met"] is False else "ink", cx=x, cy=middle, r=3.5)


def _leaders(picture: SvgPicture, leaders: Sequence[Mapping[str, Any]], scale: Scale, top: float) -> None:
    for each in leaders:
        x = scale(each["begin_s"])
        picture.add("path", "ink", d=star_path(x, top - 7, 6))
        picture.words(x + 9, top - 4, f"{each['robot']} leads", "soft small")


def _faults(picture: SvgPicture, faults: Sequence[Mapping[str, Any]], scale: Scale, top: float, bottom: float) -> None:
    beyond = 0.0
    for fault in faults:
        begin = fault.get("from", fault.get("at", 0.0))
        if begin > scale.high:
            continue
        x = scale(begin)
        width = max(1.0, scale(min(fault.get("to", begin), scale.high)) - x)
        what = {key: value for key, value in fault.items() if key not in {"from", "to", "at"}}
        band = element("rect", "band", x=x, y=top, width=width, height=bottom - top)
        words = ", ".join(f"{key} {value}" for key, value in what.items())
        picture.parts.append(f"<g><title>{words.replace('&', '&amp;').replace('<', '&lt;')}</title>{band}</g>")
        named = " ".join(what)
        if x >= beyond:  # of faults close to each other only the first one has a name
            picture.words(x + 2, bottom + 30, named, "missed small")
            beyond = x + 8 + 6.5 * len(named)


# -- lateness --------------------------------------------------------------------------------------------------------


def lateness(data: RunData) -> str:
    """Return how early or late each job was done, by deadline; on the right of zero is too late."""
    jobs = data.jobs
    shown = jobs
    if len(jobs) > JOBS_MAX:
        worst = sorted(jobs, key=lambda job: _lateness(job, data.end_s), reverse=True)[:JOBS_MAX]
        shown = [job for job in jobs if any(job is each for each in worst)]
    top = 58.0
    bottom = top + 20.0 * max(1, len(shown))
    more = f" (the latest {len(shown)} of {len(jobs)} jobs)" if len(shown) < len(jobs) else ""
    picture = _picture(bottom + 44, f"{data.title}: lateness of jobs{more}")
    values = [_lateness(job, data.end_s) for job in shown]
    low = min([0.0, *values])
    high = max([0.0, *values])
    room = 0.14 * (high - low) or 1.0
    scale = Scale(low - room, high + room, 190, WIDTH - RIGHT)
    time_axis(picture, scale, top, bottom)
    if not jobs:
        picture.words(200, top + 14, "no time assertion was started in this run", "soft")
    for row, (job, late) in enumerate(zip(shown, values, strict=True)):
        _job(picture, data, job, late, scale, top + 20.0 * row)
    picture.add("line", "zero edge", x1=scale(0.0), y1=top - 4, x2=scale(0.0), y2=bottom)
    picture.words(scale(0.0), top - 8, "deadline", "small middle")
    picture.words(
        20,
        bottom + 34,
        "finish less deadline; below zero: in time; open: not done when the recording ended",
        "soft small",
    )
    return picture.text()


def _lateness(job: Mapping[str, Any], end_s: float) -> float:
    """Return finish less deadline; of a job that is not done, how late it was at the end."""
    return float((end_s if job["finish_s"] is None else job["finish_s"]) - job["deadline_s"])


def _job(picture: SvgPicture, data: RunData, job: Mapping[str, Any], late: float, scale: Scale, top: float) -> None:
    open_ = job["finish_s"] is None
    missed = job["met"] is False
    kind = "missed" if missed else robot_class(data.robots.index(job["robot"]))
    left, right = sorted((scale(0.0), scale(late)))
    opacity = 0.25 if open_ else 1.0
    width = max(0.8, right - left)
    picture.add("rect", f"bar edge {kind}", x=left, y=top + 4, width=width, height=12, fill_opacity=opacity)
    picture.words(184, top + 14, f"{job['robot']}: {job['job']}"[:30], "small end")
    if missed:
        picture.cross(scale(late), top + 10)
    shown = "open" if open_ and not missed else f"{late:+.2f} s{', not done' if open_ else ''}"
    beyond = right + 8 if late > 0 else left - 6
    picture.words(beyond, top + 14, shown, f"{'missed' if missed else 'soft'} small number{'' if late > 0 else ' end'}")


# -- radio -----------------------------------------------------------------------------------------------------------


def radio(data: RunData) -> str:
    """Return airtime by kind of frame, and repeats and losses, over time."""
    load = data.radio
    picture = _picture(400, f"{data.title}: radio, {load.frames} transmissions")
    scale = Scale(0.0, max(data.end_s, load.bins * load.bin_s, 1e-3), LEFT, WIDTH - RIGHT)
    if not load.frames:
        picture.words(LEFT, 70, "the recording holds no frame", "soft")
    _airtime(picture, data, scale, 66.0, 200.0)
    _losses(picture, data, scale, 262.0, 360.0)
    return picture.text()


def _airtime(picture: SvgPicture, data: RunData, scale: Scale, top: float, bottom: float) -> None:
    load = data.radio
    kinds = sorted(load.airtime, key=lambda kind: (-sum(load.airtime[kind].values()), kind))
    shares = [
        list(accumulate(100.0 * load.airtime[kind].get(place, 0.0) / load.bin_s for kind in kinds))
        for place in range(load.bins)
    ]
    high = max((each[-1] for each in shares if each), default=0.0)
    up = Scale(0.0, high * 1.05 or 1.0, bottom, top)
    time_axis(picture, scale, top, bottom)
    value_axis(picture, up, LEFT, WIDTH - RIGHT, " %")
    picture.words(20, top - 20, f"airtime in bins of {load.bin_s:g} s, by kind of frame", "small")
    for index, _ in enumerate(kinds):
        d = "".join(
            _column(scale, up, place * load.bin_s, load.bin_s, each[index - 1] if index else 0.0, each[index])
            for place, each in enumerate(shares)
        )
        picture.add("path", robot_class(index), d=d)
    legend(picture, LEFT, top - 4, [(robot_class(index), kind) for index, kind in enumerate(kinds)])


def _losses(picture: SvgPicture, data: RunData, scale: Scale, top: float, bottom: float) -> None:
    load = data.radio
    classes = {"repeats": "waiting", "no_ack": "missed", "access_failure": "claiming"}
    highest = max((count for counts in load.counts.values() for count in counts.values()), default=0)
    up = Scale(0.0, max(1.0, highest * 1.1), bottom, top)
    time_axis(picture, scale, top, bottom)
    value_axis(picture, up, LEFT, WIDTH - RIGHT)
    picture.words(20, top - 20, f"repeats and frames given up, in bins of {load.bin_s:g} s", "small")
    width = load.bin_s / len(classes)
    for index, what in enumerate(classes):
        counts = sorted(load.counts[what].items())
        begin = index * width
        d = "".join(_column(scale, up, place * load.bin_s + begin, width, 0.0, count) for place, count in counts)
        picture.add("path", classes[what], d=d)
    totals = {what: sum(load.counts[what].values()) for what in classes}
    legend(
        picture, LEFT, top - 4, [(kind, f"{what.replace('_', ' ')} ({totals[what]})") for what, kind in classes.items()]
    )


def _column(scale: Scale, up: Scale, begin: float, width: float, low: float, high: float) -> str:
    """Return a column of a histogram as the data of a path."""
    if high <= low:
        return ""
    x = number(scale(begin))
    wide = number(scale(begin + width) - scale(begin))
    return f"M{x} {number(up(low))}V{number(up(high))}h{wide}V{number(up(low))}z"


PICTURES: Final[dict[str, Callable[[RunData], str]]] = {
    "trajectories": trajectories,
    "turns": turns,
    "lateness": lateness,
    "radio": radio,
}
"""The pictures of a run by the names of their files."""
