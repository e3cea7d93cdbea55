"""A run as an animated GIF, for places that show no animated SVG: floor, robots, deadlines, lanes, clock.

Drawn with Pillow, which comes with matplotlib (the extra `plot`). Simpler than the SVG, and always light.
"""

import io
import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any, Final

from PIL import Image, ImageDraw, ImageFont

from rmr_view.animation import HOLD_S, quick_motion
from rmr_view.run_data import RunData, Track
from rmr_view.run_pictures import time_end
from rmr_view.svg_picture import KIND_COLOURS, ROBOT_COLOURS, THEMES, VERMILION, FloorDrawing, Scale

WIDTH: Final = 720
FLOOR_HEIGHT: Final = 420
LEFT: Final = 70
LANE: Final = 16
FRAMES_PER_S: Final = 10
_THEME: Final = THEMES["light"]
_COLOURS: Final = (*ROBOT_COLOURS, _THEME["ink"])


def film_of(data: RunData, speed: float | None = None) -> bytes:
    """Return the animation of a run as the octets of a GIF; `speed` is lab time over time, as of `animation`."""
    film = _Film(data)
    rate = speed or quick_motion(data.end_s)
    count = max(1, math.ceil(data.end_s / rate * FRAMES_PER_S))
    frames = [film.frame(min(data.end_s, k * rate / FRAMES_PER_S)) for k in range(count + 1)]
    length_ms = 1000 // FRAMES_PER_S
    lengths = [length_ms] * count + [int(1000 * HOLD_S)]
    octets = io.BytesIO()
    frames[0].save(octets, "GIF", save_all=True, append_images=frames[1:], duration=lengths, loop=0, optimize=True)
    return octets.getvalue()


class _Film:
    """The frames of one run."""

    def __init__(self, data: RunData) -> None:
        self._data = data
        self._floor = FloorDrawing(data.floor, 12, 34, WIDTH - 24, FLOOR_HEIGHT)
        self._top = round(34 + self._floor.height_px + 14)
        self._height = self._top + LANE * len(data.robots) + 12
        self._scale = Scale(0.0, time_end(data), LEFT, WIDTH - 14)
        self._font = ImageFont.load_default(12)
        self._background = self._empty()

    def frame(self, t: float) -> Image.Image:
        """Return the picture of an instant."""
        image = self._background.copy()
        pen = ImageDraw.Draw(image)
        pen.text((WIDTH - 14, 10), f"{t:.1f} s", _THEME["ink"], self._font, anchor="ra")
        shown = [(index, robot) for index, robot in enumerate(self._data.robots) if self._data.tracks.get(robot)]
        for index, robot in shown:
            self._trail(pen, self._data.tracks[robot], t, _COLOURS[index % len(_COLOURS)])
        for index, robot in shown:
            self._robot(pen, index, robot, t)
        for index, lane in enumerate(self._data.timeline["lanes"]):
            self._lane(pen, lane, self._top + LANE * index, t)
        pen.line([(self._scale(t), self._top - 3), (self._scale(t), self._height - 10)], _THEME["ink"])
        return image.quantize(64)

    def _empty(self) -> Image.Image:
        floor = self._floor
        image = Image.new("RGB", (WIDTH, self._height), _THEME["paper"])
        pen = ImageDraw.Draw(image)
        pen.text((12, 10), self._data.title, _THEME["ink"], self._font)
        for obstacle in self._data.floor["obstacles"]:
            if "corners" in obstacle:
                pen.polygon([(floor.x(x), floor.y(y)) for x, y in obstacle["corners"]], _THEME["wall"])
            else:
                x, y = obstacle["centre"]
                pen.ellipse(_box(floor.x(x), floor.y(y), obstacle["radius"] * floor.scale), _THEME["wall"])
        for area in self._data.floor["areas"]:
            for x, y in () if area["box"] else (*area["places"], *area["queue"]):
                pen.ellipse(_box(floor.x(x), floor.y(y), floor.radius_px), outline=_THEME["grid"])
        corners = [(floor.x(0.0), floor.y(0.0) - floor.height_px), (floor.x(0.0) + floor.width_px, floor.y(0.0))]
        pen.rectangle(corners, outline=_THEME["ink"])
        return image

    def _trail(self, pen: ImageDraw.ImageDraw, track: Track, t: float, colour: str) -> None:
        last = bisect_right(track.t, t)
        places = [(self._floor.x(track.x[k]), self._floor.y(track.y[k])) for k in range(last)]
        if len(places) > 1:
            pen.line(places, colour, 2)

    def _robot(self, pen: ImageDraw.ImageDraw, index: int, robot: int, t: float) -> None:
        x, y, heading = place_at(self._data.tracks[robot], t)
        px = self._floor.x(x)
        py = self._floor.y(y)
        radius = self._floor.radius_px
        jobs = self._data.timeline["lanes"][index]["deadlines"]
        for job in jobs:
            if job["met"] is False and job["deadline_s"] <= t:
                _cross(pen, px + radius, py - radius, 6)
                pen.ellipse(_box(px, py, radius + 4), outline=VERMILION, width=3)
            elif job["begin_s"] <= t < min(job["deadline_s"], _end_of(job)):
                left = (job["deadline_s"] - t) / max(1e-9, job["deadline_s"] - job["begin_s"])
                pen.arc(_box(px, py, radius + 4), -90, -90 + 360 * left, _THEME["ink"], 3)
        pen.ellipse(_box(px, py, radius), _COLOURS[index % len(_COLOURS)], _THEME["ink"])
        nose = [(px + k * radius * math.cos(heading), py - k * radius * math.sin(heading)) for k in (0.6, 0.95)]
        pen.line(nose, _THEME["paper"], 2)
        pen.text(
            (px, py), str(robot), _THEME["paper"], self._font, anchor="mm", stroke_width=1, stroke_fill=_THEME["ink"]
        )

    def _lane(self, pen: ImageDraw.ImageDraw, lane: Mapping[str, Any], top: float, t: float) -> None:
        scale = self._scale
        pen.text((LEFT - 8, top + LANE / 2), f"robot {lane['robot']}", _THEME["ink"], self._font, anchor="rm")
        for each in lane["intervals"]:
            if each["begin_s"] < t:
                ends = (scale(each["begin_s"]), scale(min(t, each["end_s"])))
                colour = KIND_COLOURS.get(each["kind"], _THEME["soft"])
                pen.rectangle([(ends[0], top + 3), (max(ends), top + LANE - 4)], colour)
        middle = top + LANE / 2
        for job in lane["deadlines"]:
            x = scale(min(job["deadline_s"], scale.high))
            pen.polygon([(x - 4, middle - 4), (x + 4, middle - 4), (x, middle + 4)], _THEME["ink"])
            if job["met"] is False and job["deadline_s"] <= t:
                _cross(pen, x, middle, 4)
            if _end_of(job) <= t:
                colour = VERMILION if job["met"] is False else _THEME["ink"]
                pen.ellipse(_box(scale(job["finish_s"]), middle, 3), colour)


def place_at(track: Track, t: float) -> tuple[float, float, float]:
    """Return x, y and heading at an instant, on the line between the poses before and after."""
    after = min(bisect_right(track.t, t), len(track) - 1)
    before = max(0, after - 1)
    span = track.t[after] - track.t[before]
    share = min(1.0, max(0.0, (t - track.t[before]) / span)) if span > 0.0 else 0.0
    turned = math.remainder(track.heading[after] - track.heading[before], math.tau)
    return (
        _between(track.x, before, after, share),
        _between(track.y, before, after, share),
        track.heading[before] + share * turned,
    )


def _between(column: Sequence[float], before: int, after: int, share: float) -> float:
    return column[before] + share * (column[after] - column[before])


def _end_of(job: Mapping[str, Any]) -> float:
    return math.inf if job["finish_s"] is None else float(job["finish_s"])


def _box(x: float, y: float, radius: float) -> tuple[float, float, float, float]:
    return x - radius, y - radius, x + radius, y + radius


def _cross(pen: ImageDraw.ImageDraw, x: float, y: float, reach: float) -> None:
    pen.line([(x - reach, y - reach), (x + reach, y + reach)], VERMILION, 3)
    pen.line([(x - reach, y + reach), (x + reach, y - reach)], VERMILION, 3)
