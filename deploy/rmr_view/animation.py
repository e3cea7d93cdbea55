"""A run as an animated SVG: robots on the floor, their deadlines, a clock, and their lanes below.

Everything moves by CSS animations of one length, which browsers run in an image, too, without any script. The
attributes of the elements are those of the run's end, which is shown by programs without animations and to readers who
prefer reduced motion. What moves is thinned out until the file is small enough.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

from rmr_view.run_data import RunData, Track, thinned, unwrapped
from rmr_view.run_pictures import time_end
from rmr_view.svg_picture import (
    FLOOR_STYLE,
    KIND_COLOURS,
    LABEL_STYLE,
    LEFT,
    WIDTH,
    FloorDrawing,
    Scale,
    SvgPicture,
    cross_path,
    deadline_path,
    element,
    label_class,
    legend,
    number,
    robot_class,
    star_path,
)
from rmr_view.turn_intervals import GONE

HOLD_S = 2.5
"""Time for which the end is shown before an animation begins anew, seconds."""


class Keyframes:
    """CSS animations of one length, from values at instants of lab time; equal ones are written once."""

    def __init__(self, end_s: float, speed: float) -> None:
        """`speed` is lab time over time."""
        self._end_s = end_s
        self._speed = speed
        self._length_s = end_s / speed + HOLD_S
        self._names: dict[str, str] = {}

    def moving(self, stops: Sequence[tuple[float, str]], step_ends: Sequence[int] = ()) -> str:
        """Return the classes of an element that has each declaration at its instant, and changes evenly between.

        `step_ends` are the numbers of jumps from each stop to the next one in place of an even change.
        """
        texts: dict[str, list[str]] = {}
        for place, (at, declaration) in enumerate(stops):
            steps = f";animation-timing-function:steps({step_ends[place]})" if _jumps(step_ends, place) else ""
            percents = texts.setdefault(declaration + steps, [])
            percents += [*(["0%"] if not place and at > 0.0 else []), self._percent(at)]
        texts.setdefault(stops[-1][1], []).append("100%")
        return self._named("".join(f"{','.join(dict.fromkeys(p))}{{{d}}}" for d, p in texts.items()))

    def shown(self, spans: Sequence[tuple[float, float]]) -> str:
        """Return the attributes of an element that is visible in these spans of lab time; inf: no end."""
        last = any(end == math.inf for _, end in spans)
        rest = "" if last else 'opacity="0" '
        percents = [(self._percent(begin), self._percent(end) if end < math.inf else "") for begin, end in spans]
        percents = [(begin, end) for begin, end in percents if begin != end]  # too short to be seen
        visible = [begin for begin, _ in percents]
        hidden = [end for _, end in percents if end and end not in visible]
        if "0%" not in visible:
            hidden.insert(0, "0%")
        (visible if last else hidden).append("100%")
        step = ";animation-timing-function:step-end"
        body = "".join(
            f"{','.join(places)}{{opacity:{opacity}{step}}}"
            for opacity, places in ((1, visible), (0, hidden))
            if places
        )
        return f'{rest}class="{self._named(body)}"'

    def style(self) -> str:
        """Return the style sheet of all animations that were asked for."""
        head = f".a {{ animation: {self._length_s:.2f}s linear infinite }}\n"
        return head + "".join(
            f".{name}{{animation-name:{name}}}@keyframes {name}{{{body}}}\n" for body, name in self._names.items()
        )

    def _named(self, body: str) -> str:
        return f"a {self._names.setdefault(body, f'k{len(self._names)}')}"

    def _percent(self, at: float) -> str:
        share = 100.0 * min(max(at, 0.0), self._end_s) / self._speed / self._length_s
        return f"{share:.2f}".rstrip("0").rstrip(".") + "%"


def _jumps(step_ends: Sequence[int], place: int) -> bool:
    return place < len(step_ends) and step_ends[place] > 0


FLOOR_HEIGHT: Final = 520.0
RIGHT: Final = 110.0
OCTETS_MAX: Final = 300_000
"""Bound of the file's size: images of a page should load at once."""
LENGTH_S: Final = 15.0
"""An animation lasts no longer than this, if necessary in quick motion."""
_CLOCK_PX: Final = 24.0
STYLE: Final = (
    LABEL_STYLE
    + FLOOR_STYLE
    + """\
.trail { fill: none; stroke-width: 2.5; stroke-opacity: 0.55; stroke-dasharray: 1 }
.ring { fill: none; stroke-width: 3.5; stroke-dasharray: 1 }
.track { fill: none; stroke-width: 3.5 }
.nose { stroke-width: 3; stroke-linecap: round }
.bar { stroke-width: 0.6 }
.clock { font-size: 20px; font-weight: 600 }
.dead { fill: #000; fill-opacity: 0.6 }
.cross { stroke-width: 3.5 }
.grid { stroke-opacity: 0.6 }
.cursor { stroke-width: 1.5 }
@media (prefers-reduced-motion: reduce) { * { animation: none !important } }
"""
)


def animation(data: RunData, speed: float | None = None) -> str:
    """Return the animation of a run; `speed` is lab time over time, None: real time unless that takes too long."""
    for doublings in range(6):
        # Detail of a robot's way at first; doubled until the file is small enough.
        text = _Animation(data, speed or quick_motion(data.end_s), 0.6 * 2**doublings).text()
        if len(text) <= OCTETS_MAX:
            break
    return text


def quick_motion(end_s: float) -> float:
    """Return the factor, 1, 2, 5, 10, ..., with which so many seconds last no longer than `LENGTH_S`."""
    return next(f for f in (k * 10.0**p for p in range(9) for k in (1, 2, 5)) if end_s <= f * LENGTH_S)


class _Animation:
    """One animation with one degree of detail."""

    def __init__(self, data: RunData, speed: float, within_px: float) -> None:
        self._data = data
        self._speed = speed
        self._within_px = within_px
        self._frames = Keyframes(data.end_s, speed)
        self._floor = FloorDrawing(data.floor, 20, 52, WIDTH - 40, FLOOR_HEIGHT)
        self._lane = 22.0 if len(data.robots) <= 12 else 12.0
        self._top = 52 + self._floor.height_px + 34
        self._bottom = self._top + self._lane * len(data.robots)
        self._picture = SvgPicture(WIDTH, self._bottom + 58, data.title)

    def text(self) -> str:
        picture = self._picture
        picture.words(20, 32, self._data.title, "title")
        self._clock()
        self._floor.draw(picture)
        shown = [(index, robot) for index, robot in enumerate(self._data.robots) if self._data.tracks.get(robot)]
        kept = {robot: self._kept(self._data.tracks[robot]) for _, robot in shown}
        for index, robot in shown:
            self._trail(index, self._data.tracks[robot], kept[robot])
        for index, robot in shown:
            self._robot(index, robot, kept[robot])
        self._lanes()
        picture.style += STYLE + self._frames.style()
        return picture.text()

    # -- clock ---------------------------------------------------------------------------------------------------

    def _clock(self) -> None:
        end = self._data.end_s
        step = max(1, math.ceil(end / 200))  # steps of the clock at most
        count = int(end / step)
        texts = [f"{k * step} s" for k in range(count + 1)]
        if end > count * step:
            texts.append(f"{end:.1f} s")
        last = len(texts) - 1
        stops = [(float(k * step), f"transform:translateY(-{k * _CLOCK_PX:g}px)") for k in (0, count)]
        stops.append((end, f"transform:translateY(-{last * _CLOCK_PX:g}px)"))
        strip = [element("text", "clock end number", text, x=0, y=k * _CLOCK_PX) for k, text in enumerate(texts)]
        moved = self._frames.moving(stops, step_ends=[count, 1])
        clip = element("rect", x=-120, y=-20, width=130, height=26)
        place = f'transform="translate({WIDTH - 24:g} 34)"'
        moving = f'<g class="{moved}" transform="translate(0 -{last * _CLOCK_PX:g})">{"".join(strip)}</g>'
        self._picture.parts.append(
            f'<clipPath id="dial">{clip}</clipPath><g {place} clip-path="url(#dial)">{moving}</g>'
        )
        if self._speed != 1.0:
            self._picture.words(WIDTH - 110, 32, f"{self._speed:g} x real time", "soft small end")

    # -- robots --------------------------------------------------------------------------------------------------

    def _kept(self, track: Track) -> list[int]:
        return thinned(track.t, (track.x, track.y), self._within_px / self._floor.scale)

    def _trail(self, index: int, track: Track, kept: Sequence[int]) -> None:
        places = [(self._floor.x(track.x[k]), self._floor.y(track.y[k])) for k in kept]
        lengths = [0.0]
        for a, b in pairwise(places):
            lengths.append(lengths[-1] + math.dist(a, b))
        if lengths[-1] < 1.0:
            return
        moved = [
            (track.t[k], f"stroke-dashoffset:{1 - s / lengths[-1]:.3g}") for k, s in zip(kept, lengths, strict=True)
        ]
        d = "M" + "L".join(f"{number(x)} {number(y)}" for x, y in places)
        kind = f"trail {robot_class(index, stroke=True)} {self._frames.moving(moved)}"
        self._picture.add("path", kind, pathLength="1", d=d)

    def _robot(self, index: int, robot: int, kept: Sequence[int]) -> None:
        track = self._data.tracks[robot]
        where = [(self._floor.x(track.x[k]), self._floor.y(track.y[k])) for k in kept]
        stops = [
            (track.t[k], f"transform:translate({number(x)}px,{number(y)}px)")
            for k, (x, y) in zip(kept, where, strict=True)
        ]
        x, y = where[-1]
        moved = f'class="{self._frames.moving(stops)}" transform="translate({number(x)} {number(y)})"'
        radius = self._floor.radius_px
        parts = [element("circle", f"bar edge {robot_class(index)}", r=radius), self._nose(track, radius)]
        size = min(14.0, max(6.0, radius * (1.1 if robot < 10 else 0.85)))
        words = element(
            "text", f"middle {label_class(index)}", str(robot), y=0.36 * size, style=f"font-size:{size:g}px"
        )
        lane = self._data.timeline["lanes"][index]
        parts += [words, *self._rings(lane, radius), *self._dead(lane, radius), *self._star(robot, radius)]
        self._picture.parts.append(f"<g {moved}>{''.join(parts)}</g>")

    def _nose(self, track: Track, radius: float) -> str:
        degrees = [-math.degrees(angle) for angle in unwrapped(track.heading)]
        stops = [(track.t[k], f"transform:rotate({degrees[k]:.0f}deg)") for k in thinned(track.t, (degrees,), 5.0)]
        line = element("line", "nose halo", x1=0.62 * radius, x2=0.92 * radius)
        return f'<g class="{self._frames.moving(stops)}" transform="rotate({degrees[-1]:.0f})">{line}</g>'

    def _rings(self, lane: Mapping[str, Any], radius: float) -> list[str]:
        """Return the time left to the robot's deadlines as a ring that shrinks, and a mark once one is missed."""
        parts = []
        for job in lane["deadlines"]:
            done = min(self._data.end_s if job["finish_s"] is None else job["finish_s"], job["deadline_s"])
            span = job["deadline_s"] - job["begin_s"]
            gone = min(1.0, max(0.0, (done - job["begin_s"]) / span)) if span > 0.0 else 1.0
            shown = self._frames.shown([(job["begin_s"], min(done, self._data.end_s))])
            shrinking = self._frames.moving(
                [(job["begin_s"], "stroke-dashoffset:0"), (done, f"stroke-dashoffset:-{gone:.3g}")]
            )
            ring = element("circle", f"ring edge {shrinking}", pathLength="1", r=radius + 4, transform="rotate(-90)")
            track = element("circle", "track faint", r=radius + 4)
            parts.append(f"<g {shown}>{track}{ring}</g>")
            if job["met"] is False:
                missed = self._frames.shown([(job["deadline_s"], math.inf)])
                cross = element("path", "miss cross", d=cross_path(radius + 5, -radius - 5, 6))
                parts.append(f"<g {missed}>{element('circle', 'miss', r=radius + 4)}{cross}</g>")
        return parts

    def _dead(self, lane: Mapping[str, Any], radius: float) -> list[str]:
        spans = [(each["begin_s"], each["end_s"]) for each in lane["intervals"] if each["kind"] in GONE.values()]
        if not spans:
            return []
        cross = element("path", "nose halo line", d=cross_path(0, 0, 0.6 * radius))
        return [f"<g {self._frames.shown(self._lasting(spans))}>{element('circle', 'dead', r=radius)}{cross}</g>"]

    def _star(self, robot: int, radius: float) -> list[str]:
        spans = [(each["begin_s"], each["end_s"]) for each in self._data.timeline["leaders"] if each["robot"] == robot]
        if not spans:
            return []
        star = element("path", "ink", d=star_path(-radius - 4, -radius - 4, 7))
        return [f"<g {self._frames.shown(self._lasting(spans))}>{star}</g>"]

    def _lasting(self, spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Return spans of time; one that lasts until the end of the recording has no end."""
        return [(begin, math.inf if end >= self._data.end_s else end) for begin, end in spans]

    # -- lanes ---------------------------------------------------------------------------------------------------

    def _lanes(self) -> None:
        picture = self._picture
        scale = Scale(0.0, time_end(self._data), LEFT, WIDTH - RIGHT)
        now = scale(self._data.end_s)
        lanes = self._data.timeline["lanes"]
        for index, lane in enumerate(lanes):
            self._bars(lane, scale, self._top + self._lane * index)
        height = self._bottom - self._top
        area = element("rect", x=LEFT, y=self._top, width=WIDTH - RIGHT - LEFT, height=height)
        picture.parts.append(f'<clipPath id="lanes">{area}</clipPath>')
        stops = [
            (0.0, f"transform:translateX({LEFT:g}px)"),
            (self._data.end_s, f"transform:translateX({number(now)}px)"),
        ]
        moved = f'class="{self._frames.moving(stops)}" transform="translate({number(now)} 0)"'
        curtain = element("rect", "paper", y=self._top, width=WIDTH, height=height)
        picture.parts.append(f'<g clip-path="url(#lanes)"><g {moved}>{curtain}</g></g>')
        self._marks(lanes, scale)
        ring = ("ring", "time left to the deadline")
        kinds = [(kind, kind) for kind in KIND_COLOURS]
        marks = [("leads", "leads"), ("deadline", "deadline"), ("done", "done"), ("miss", "missed")]
        legend(picture, LEFT, self._bottom + 42, [*kinds, *marks, ring])
        cursor = element("line", "cursor edge", y1=self._top - 4, y2=self._bottom)
        picture.parts.append(f"<g {moved}>{cursor}</g>")

    def _bars(self, lane: Mapping[str, Any], scale: Scale, top: float) -> None:
        for each in lane["intervals"]:
            x = scale(each["begin_s"])
            width = max(0.8, scale(each["end_s"]) - x)
            kind = "soft" if each["kind"] in {"stalled", *GONE.values()} else each["kind"]
            self._picture.add("rect", f"bar edge {kind}", x=x, y=top + 4, width=width, height=self._lane - 8)

    def _marks(self, lanes: Sequence[Mapping[str, Any]], scale: Scale) -> None:
        """Draw times, names, deadlines and what became of them, which the curtain does not cover."""
        picture = self._picture
        for tick in scale.ticks():
            picture.add("line", "faint grid", x1=scale(tick), y1=self._top, x2=scale(tick), y2=self._bottom)
            picture.words(scale(tick), self._bottom + 15, f"{tick:g} s", "soft small middle number")
        for index, lane in enumerate(lanes):
            middle = self._top + self._lane * (index + 0.5)
            picture.add("circle", f"bar edge {robot_class(index)}", cx=26, cy=middle, r=min(6.0, self._lane / 2 - 1))
            picture.words(LEFT - 8, middle + 4, f"robot {lane['robot']}", "end small")
            for job in lane["deadlines"]:
                self._deadline(job, scale, middle)
            self._outcomes(lane["deadlines"], middle)

    def _deadline(self, job: Mapping[str, Any], scale: Scale, middle: float) -> None:
        if job["deadline_s"] <= scale.high:
            self._picture.add("path", "ink", d=deadline_path(scale(job["deadline_s"]), middle))
        parts = []
        if job["met"] is False:
            at = job["deadline_s"]
            parts.append((at, element("path", "miss", d=cross_path(scale(min(at, scale.high)), middle, 5))))
        if job["finish_s"] is not None:
            kind = "missed" if job["met"] is False else "ink"
            parts.append((job["finish_s"], element("circle", kind, cx=scale(job["finish_s"]), cy=middle, r=3.5)))
        for at, part in parts:
            self._picture.parts.append(f"<g {self._frames.shown([(at, math.inf)])}>{part}</g>")

    def _outcomes(self, jobs: Sequence[Mapping[str, Any]], middle: float) -> None:
        """Write how early or late the robot's last job was done, or that it is late."""
        told = [(job["deadline_s"], "missed", "missed") for job in jobs if job["met"] is False]
        for job in jobs:
            if job["finish_s"] is not None:
                late = job["finish_s"] - job["deadline_s"]
                kind = "missed" if job["met"] is False else "soft"
                told.append((job["finish_s"], kind, f"{abs(late):.1f} s {'late' if late > 0 else 'early'}"))
        told.sort()
        for place, (at, kind, words) in enumerate(told):
            until = told[place + 1][0] if place + 1 < len(told) else math.inf
            text = element("text", f"{kind} small number", words, x=WIDTH - RIGHT + 12, y=middle + 4)
            self._picture.parts.append(f"<g {self._frames.shown([(at, until)])}>{text}</g>")
