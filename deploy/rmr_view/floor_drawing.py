"""The floor of a recorded run as SVG: walls, obstacles, areas with slots and queues, beacons, bottleneck."""

from collections.abc import Mapping, Sequence
from typing import Any

from rmr_view.svg_picture import SvgPicture, element, number

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
