"""SVG written as text: elements, numbers, axes, the floor, and the style that all pictures of a run share.

No library draws, so that the pictures come with the default installation and equal data give equal octets. Colours are
classes of one style sheet, with a second set for `prefers-color-scheme: dark`; a picture needs no script. The colours
are those of Okabe and Ito ("Color Universal Design", 2008); shapes, hatching and text repeat what a colour says.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

VERMILION = "#D55E00"
"""What was missed or failed; nothing else has this colour."""
ROBOT_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9")
"""Colours of robots, in the order of their ids; the sixth has the colour of the text, the seventh begins anew."""
KIND_COLOURS = {"asking": "#F0E442", "waiting": "#56B4E9", "claiming": "#CC79A7", "inside": "#009E73"}
"""Colours of what a robot does about its turn."""

WIDTH = 900.0
LEFT = 90.0
"""Width of a picture of a run, and its margin on the left, where the names of the lanes stand."""
THEMES = {
    "light": {"paper": "#ffffff", "ink": "#1f2328", "soft": "#59636e", "grid": "#d9dee3", "wall": "#8c959f"},
    "dark": {"paper": "#0d1117", "ink": "#f0f6fc", "soft": "#9198a1", "grid": "#30363d", "wall": "#6e7681"},
}
"""Colours of surfaces and texts by theme."""
_COLOURED = """\
.paper {{ fill: {paper} }}
.ink {{ fill: {ink} }}
text {{ fill: {ink} }}
.soft {{ fill: {soft} }}
.wall {{ fill: {wall} }}
.edge {{ stroke: {ink} }}
.faint {{ stroke: {grid} }}
.mid {{ stroke: {soft} }}
.halo {{ stroke: {paper} }}
.on-ink {{ fill: {paper} }}
"""
_PLAIN = """\
text { font: 12px system-ui, -apple-system, "Segoe UI", Helvetica, Arial, sans-serif }
.title { font-size: 14px; font-weight: 600 }
.small { font-size: 11px }
.end { text-anchor: end }
.middle { text-anchor: middle }
.number { font-variant-numeric: tabular-nums }
.line { fill: none }
.miss { stroke: #D55E00; fill: none; stroke-width: 2.5; stroke-linecap: round }
.missed { fill: #D55E00 }
text.missed { fill: #D55E00; font-weight: 600 }
"""


class SvgPicture:
    """A picture that is written from back to front."""

    def __init__(self, width: float, height: float, title: str, style: str = "") -> None:
        """`style` is added to the style sheet."""
        self.width = width
        self.height = height
        self._title = title
        self.style = style
        self.parts: list[str] = []

    def text(self) -> str:
        """Return the picture as the text of a file."""
        size = f'width="{number(self.width)}" height="{number(self.height)}"'
        box = f'viewBox="0 0 {number(self.width)} {number(self.height)}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {box} role="img">\n<title>{escape(self._title)}</title>'
        dark = "@media (prefers-color-scheme: dark) {\n" + _COLOURED.format(**THEMES["dark"]) + "}\n"
        robots = "".join(f".r{i} {{ fill: {c} }}\n.s{i} {{ stroke: {c} }}\n" for i, c in enumerate(ROBOT_COLOURS))
        kinds = "".join(f".{kind} {{ fill: {colour} }}\n" for kind, colour in KIND_COLOURS.items())
        style = _PLAIN + _COLOURED.format(**THEMES["light"]) + dark + robots + kinds + self.style
        paper = element("rect", "paper", width=self.width, height=self.height, rx=6)
        return "\n".join([head, f"<style>\n{style}</style>", paper, *self.parts, "</svg>\n"])

    def add(self, tag: str, kind: str = "", text: str | None = None, **attributes: float | str) -> None:
        """Add an element of the classes `kind`."""
        self.parts.append(element(tag, kind, text, **attributes))

    def words(self, x: float, y: float, text: str, kind: str = "") -> None:
        """Add a text whose base line begins at (x, y)."""
        self.add("text", kind, text, x=x, y=y)

    def cross(self, x: float, y: float) -> None:
        """Add the mark of what was missed."""
        self.add("path", "miss", d=cross_path(x, y, 5.0))


def element(tag: str, kind: str = "", text: str | None = None, **attributes: float | str) -> str:
    """Return an element; an underscore in an attribute's name stands for a hyphen."""
    words = [tag, *([f'class="{kind}"'] if kind else [])]
    for name, value in attributes.items():
        shown = escape(value) if isinstance(value, str) else number(value)
        words.append(f'{name.replace("_", "-")}="{shown}"')
    head = " ".join(words)
    return f"<{head}/>" if text is None else f"<{head}>{escape(text, quote=False)}</{tag}>"


def cross_path(x: float, y: float, reach: float) -> str:
    """Return a diagonal cross around (x, y) as the data of a path."""
    side = number(2 * reach)
    return f"M{number(x - reach)} {number(y - reach)}l{side} {side}m0 -{side}l-{side} {side}"


def number(value: float) -> str:
    """Return a number with at most two digits behind the point, which no picture needs more than."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def robot_class(index: int, *, stroke: bool = False) -> str:
    """Return the class of the fill, or stroke, of the robot at `index` in the roster."""
    place = index % (len(ROBOT_COLOURS) + 1)
    if place == len(ROBOT_COLOURS):
        return "edge" if stroke else "ink"
    return f"s{place}" if stroke else f"r{place}"


def label_class(index: int) -> str:
    """Return the class of a text upon the robot at `index`: dark upon light colours, and the reverse."""
    place = index % (len(ROBOT_COLOURS) + 1)
    return "on-ink" if place == len(ROBOT_COLOURS) else ("on-dark" if place in {0, 2} else "on-light")


LABEL_STYLE = "text.on-ink { font-weight: 600 }\ntext.on-dark { fill: #fff; font-weight: 600 }\n" + (
    "text.on-light { fill: #1f2328; font-weight: 600 }\n"
)
"""The style of texts of `label_class`."""


class Scale:
    """A linear axis from values to places in the picture."""

    def __init__(self, low: float, high: float, begin: float, end: float) -> None:
        """Values from `low` to `high` are drawn from `begin` to `end`."""
        self.low = low
        self.high = high if high > low else low + 1.0
        self.begin = begin
        self.end = end

    def __call__(self, value: float) -> float:
        """Return the place of `value`."""
        return self.begin + (value - self.low) / (self.high - self.low) * (self.end - self.begin)

    def ticks(self, count: int = 8) -> Iterator[float]:
        """Yield round values along the axis, at most about `count`."""
        step = round_step((self.high - self.low) / count)
        first = math.ceil(self.low / step - 1e-9)
        last = math.floor(self.high / step + 1e-9)
        yield from (k * step for k in range(first, last + 1))


def round_step(least: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is not below `least`."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(power * factor for factor in (1, 2, 5, 10) if power * factor >= least * (1 - 1e-9))


def time_axis(picture: SvgPicture, scale: Scale, top: float, bottom: float) -> None:
    """Draw lines at round times from `top` to `bottom`, and the times below."""
    for tick in scale.ticks():
        x = scale(tick)
        picture.add("line", "faint", x1=x, y1=top, x2=x, y2=bottom)
        picture.words(x, bottom + 15, f"{tick:g} s", "soft small middle number")


def value_axis(picture: SvgPicture, scale: Scale, left: float, right: float, unit: str = "") -> None:
    """Draw lines at round values from `left` to `right`, and the values at their left."""
    for tick in scale.ticks(5):
        y = scale(tick)
        picture.add("line", "faint", x1=left, y1=y, x2=right, y2=y)
        picture.words(left - 6, y + 4, f"{tick:g}{unit}", "soft small end number")


def legend(picture: SvgPicture, x: float, y: float, entries: Sequence[tuple[str, str]]) -> None:
    """Draw a sample of each class, or the mark of that name (`_mark`), with its text behind it."""
    for kind, text in entries:
        picture.parts.append(
            _mark(kind, x + 6, y - 4) or element("rect", kind, x=x, y=y - 10, width=12, height=12, rx=2)
        )
        picture.words(x + 17, y, text, "soft small")
        x += 17 + 6.3 * len(text) + 16


def _mark(kind: str, x: float, y: float) -> str:
    """Return a mark around (x, y); empty: there is none of that name."""
    match kind:
        case "miss":
            return element("path", "miss", d=cross_path(x, y, 4))
        case "deadline":
            return element("path", "ink", d=deadline_path(x, y))
        case "done":
            return element("circle", "ink", cx=x, cy=y, r=3.5)
        case "leads":
            return element("path", "ink", d=star_path(x, y, 6))
        case "ring":
            rest = element("circle", "faint line", cx=x, cy=y, r=5, stroke_width=3)
            return rest + element("path", "edge line", d=f"M{number(x)} {number(y - 5)}a5 5 0 1 1 -5 5", stroke_width=3)
        case _:
            return ""


def deadline_path(x: float, y: float) -> str:
    """Return the mark of a deadline, a triangle that points down at (x, y + 5), as the data of a path."""
    return f"M{number(x - 4.5)} {number(y - 4)}h9l-4.5 9z"


def star_path(x: float, y: float, reach: float) -> str:
    """Return a star of five points around (x, y) as the data of a path: the mark of a leader."""
    corners = ((math.tau * k / 10, reach if k % 2 == 0 else 0.45 * reach) for k in range(10))
    places = (f"{number(x + r * math.sin(a))} {number(y - r * math.cos(a))}" for a, r in corners)
    return f"M{'L'.join(places)}z"


FLOOR_STYLE = """\
.floor { fill: none; stroke-width: 2 }
.slot { fill: none; stroke-width: 1.2; stroke-dasharray: 3 3 }
.beacon { fill: none; stroke-width: 1.5 }
"""
Place = Sequence[float]


class FloorDrawing:
    """Places of the floor in a picture: metres to pixels, y points up."""

    def __init__(self, floor: Mapping[str, Any], left: float, top: float, width_px: float, height_px: float) -> None:
        """Fit `floor`, the data of an arena, into a box of the picture, in the middle of its width."""
        self.floor = floor
        self.scale: float = min(width_px / floor["width"], height_px / floor["height"])
        self._left: float = left + (width_px - floor["width"] * self.scale) / 2
        self._top: float = top
        self.width_px: float = floor["width"] * self.scale
        self.height_px: float = floor["height"] * self.scale
        self.radius_px = max(2.5, floor["shape"]["radius"] * self.scale)

    def x(self, x: float) -> float:
        """Return the place in the picture of x, metres."""
        return self._left + x * self.scale

    def y(self, y: float) -> float:
        """Return the place in the picture of y, metres."""
        return self._top + self.height_px - y * self.scale

    def points(self, places: Sequence[Place]) -> str:
        """Return places as the points of a polyline."""
        return " ".join(f"{number(self.x(x))},{number(self.y(y))}" for x, y in places)

    def draw(self, picture: SvgPicture) -> None:
        """Add the floor to `picture`."""
        self._areas(picture)
        for obstacle in self.floor["obstacles"]:
            picture.parts.append(self._obstacle(obstacle))
        picture.add("rect", "floor edge", x=self._left, y=self._top, width=self.width_px, height=self.height_px)
        for x, y in self.floor["beacons"]:
            at_x = self.x(x)
            at_y = self.y(y)
            picture.add("path", "beacon edge", d=f"M{number(at_x - 6)} {number(at_y)}h12m-6 -6v12")

    def _obstacle(self, obstacle: Mapping[str, Any]) -> str:
        if "corners" in obstacle:
            return element("polygon", "wall", points=self.points(obstacle["corners"]))
        x, y = obstacle["centre"]
        return element("circle", "wall", cx=self.x(x), cy=self.y(y), r=obstacle["radius"] * self.scale)

    def _areas(self, picture: SvgPicture) -> None:
        for area in self.floor["areas"]:
            if area["box"] is not None:
                left, low, right, high = area["box"]
                corners = [(left, low), (right, low), (right, high), (left, high)]
                picture.add("polygon", "slot mid", points=self.points(corners))
                self._name(picture, area["name"], (left + right) / 2, (low + high) / 2)
                continue
            for x, y in (*area["places"], *area["queue"]):
                picture.add("circle", "slot mid", cx=self.x(x), cy=self.y(y), r=self.radius_px)
            x, y = max(area["places"], key=lambda place: (place[1], place[0]))
            self._name(picture, area["name"], x, y, self.radius_px + 4)

    def _name(self, picture: SvgPicture, name: str, x: float, y: float, up_px: float = -4.0) -> None:
        at_y = self.y(y) - up_px
        below = at_y - 10 < self._top  # no room above: the name goes below its place
        picture.words(self.x(x), self.y(y) + up_px + 10 if below else at_y, name, "soft small middle")
