"""A floor from an image: the blocked cells of an occupancy grid, as boxes.

The image is any that Pillow reads, with dark pixels where the floor is blocked, or the ``map.yaml`` of a ROS map server
(https://docs.nav2.org, "map_server"), which names an image, its resolution and its thresholds. Greys are read as nav2's
map server reads them: scaled to 8 bits, free up to and with ``free_thresh``. What a map does not know, transparent
pixels too, is blocked: no robot can go there. The lower left corner of the image is the origin of the arena.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rmr.entry.command_line import remedy
from rmr_world.document import read
from rmr_world.finding import LabError

if TYPE_CHECKING:
    from PIL import Image

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1, metres."""

PIXELS_MAX: Final = 4_000_000
"""Bound of the pixels of an image: 100 m x 100 m at 5 cm."""
BOXES_MAX: Final = 3000
"""Bound of the boxes of a map."""
SUFFIXES: Final = (".yaml", ".yml")
"""Endings of the map files of ROS; anything else is an image."""
OCCUPIED: Final = 0.65
FREE: Final = 0.196
"""Defaults of the thresholds of ROS: a share of darkness of at least `OCCUPIED` is blocked, of at most `FREE` free."""
UNKNOWN: Final = 205
"""The grey that map savers write for what they do not know; its darkness is 0.1961, just above `FREE`."""
OPAQUE: Final = 255
"""White, and the alpha of a pixel that a map knows: what is transparent is unknown."""
DEEP_MODES: Final = ("I", "I;16", "I;16B", "I;16L", "I;16N", "F")
"""Pillow's names of images of one channel with more than 8 bits; its own conversion cuts their greys off at 255."""
BITS_TAG, PHOTOMETRIC_TAG, WHITE_IS_ZERO = 258, 262, 0
"""TIFF 6.0, section 8: the tags of the bits of a channel and of what 0 means, and one of its values."""

NEGATE: Final = {
    "0": False,
    "false": False,
    "no": False,
    "off": False,
    "1": True,
    "true": True,
    "yes": True,
    "on": True,
}
"""What the map server takes for `negate`."""
KNOWN: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")


class MapError(ValueError):
    """A map that cannot be used; the message is for the author of the lab file."""


@dataclass(frozen=True, slots=True)
class FloorMap:
    """The cells of a floor."""

    blocked: np.ndarray
    """Shape (rows, columns), bool; row 0 is at the lower edge."""
    resolution_m: float | None
    """Edge of a cell; None: the map does not say."""
    unknown_free: int = 0
    """How many cells are free by the map's own `free_thresh` although they have the grey that means unknown."""

    @property
    def size_m(self) -> tuple[float, float] | None:
        """Width and height of the floor, if the map says how large it is."""
        if self.resolution_m is None:
            return None
        rows, columns = self.blocked.shape
        return round(columns * self.resolution_m, 9), round(rows * self.resolution_m, 9)


def read_map(path: Path) -> FloorMap:
    """Return the map in a file: a map file of ROS or an image. Raises MapError."""
    if path.suffix not in SUFFIXES:
        grey, opaque = _pixels(path)
        return FloorMap(~opaque | (_lightness(grey) < 0.5), None)
    about = _about(path)
    grey, opaque = _pixels(path.parent / about["image"])
    darkness = _lightness(grey) if about["negate"] else np.float32(1.0) - _lightness(grey)
    blocked = ~opaque | (darkness > np.float32(about["free_thresh"]))
    return FloorMap(blocked, about["resolution"], int(np.count_nonzero(~blocked & (grey == UNKNOWN))))


def image_of(path: Path) -> Path | None:
    """Return the image that a map file of ROS names; None for an image. Raises MapError."""
    return path.parent / _about(path)["image"] if path.suffix in SUFFIXES else None


def _lightness(grey: np.ndarray) -> np.ndarray:
    """Return the lightness, 0 (black) to 1 (white), of greys; single precision, as the map server compares it."""
    return grey.astype(np.float32) / np.float32(OPAQUE)


def boxes(floor: FloorMap, width_m: float, height_m: float) -> list[Box]:
    """Return boxes that cover the blocked cells and nothing else, on a floor of this size.

    They may overlap. Raises MapError if there are too many, if nothing is free, or if the image has other proportions.
    """
    rows, columns = floor.blocked.shape
    across, up = width_m / columns, height_m / rows
    if abs(across / up - 1.0) > 0.01:  # pixels are nearly square
        raise MapError(
            f"has {columns} x {rows} pixels, which do not fit an arena of {width_m:g} m x {height_m:g} m: "
            f"a pixel would be {across:.4g} m wide and {up:.4g} m high"
        )
    if floor.blocked.all():
        raise MapError("has no free floor: light pixels are free, dark and transparent ones blocked")
    return [
        (round(c0 * across, 9), round(r0 * up, 9), round(c1 * across, 9), round(r1 * up, 9))
        for r0, c0, r1, c1 in _rectangles(floor.blocked)
    ]


def _rectangles(blocked: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Return rectangles of cells (first row and column, row and column after the last) that cover the blocked ones.

    From the first cell that is not covered, each grows as far as it can along one axis, then along the other, and the
    larger of the two ways counts. Covered cells may be covered again: so a wall and the one across it are two boxes.
    """
    left = blocked.copy()
    found: list[tuple[int, int, int, int]] = []
    while True:
        cell = int(np.argmax(left))
        r, c = divmod(cell, left.shape[1])
        if not left[r, c]:
            return found
        if len(found) == BOXES_MAX:
            raise MapError(f"needs more than {BOXES_MAX} boxes: take an image with larger pixels, or without speckles")
        along = _run(blocked[r, c:])
        wide = (along, _run(np.all(blocked[r:, c : c + along], axis=1)))
        upward = _run(blocked[r:, c])
        high = (_run(np.all(blocked[r : r + upward, c:], axis=0)), upward)
        columns, rows = max(wide, high, key=math.prod)
        left[r : r + rows, c : c + columns] = False
        found.append((r, c, r + rows, c + columns))


def _run(cells: np.ndarray) -> int:
    """Return how many cells from the first one on are blocked."""
    return int(np.argmin(cells)) if not cells.all() else len(cells)


def _pixels(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return grey (0 is black, 255 white) and opacity (bool) of each pixel, the lowest row first. Raises MapError."""
    try:
        from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - not in every installation
    except ModuleNotFoundError as error:
        raise MapError(f"{path.name} is an image: {remedy(error)}") from None
    try:
        with Image.open(path) as image:
            if image.width * image.height > PIXELS_MAX:
                raise MapError(f"{path.name} has {image.width} x {image.height} pixels, more than {PIXELS_MAX}")
            grey, opaque = _deep(path, image) if image.mode in DEEP_MODES else _shallow(image)
    except UnidentifiedImageError:
        raise MapError(f"{path.name} is no image that can be read (PNG, PGM, BMP, TIFF, JPEG)") from None
    except MapError:
        raise
    except (OSError, SyntaxError, ValueError, TypeError, OverflowError, Image.DecompressionBombError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise MapError(f"{path.name} cannot be read: {reason}") from None
    return grey[::-1], opaque[::-1]


def _shallow(image: "Image.Image") -> tuple[np.ndarray, np.ndarray]:
    """Return grey and opacity of an image of up to 8 bits a channel."""
    colours = image.convert("RGBA")
    return np.asarray(colours.convert("RGB").convert("L")), np.asarray(colours)[..., 3] == OPAQUE


def _deep(path: Path, image: "Image.Image") -> tuple[np.ndarray, np.ndarray]:
    """Return grey and opacity of an image of one channel of more than 8 bits, scaled to 8. Raises MapError."""
    cells = np.asarray(image, dtype=np.float64)
    tags = getattr(image, "tag_v2", {})
    most = 1.0 if image.mode == "F" else 2.0 ** tags.get(BITS_TAG, (16,))[0] - 1.0
    if not ((cells >= 0.0) & (cells <= most)).all():
        raise MapError(f"{path.name} has pixels outside of 0 to {most:g}: save it with 8 bits for each pixel")
    if tags.get(PHOTOMETRIC_TAG) == WHITE_IS_ZERO and image.mode != "F":
        cells = most - cells
    return np.rint(cells / most * OPAQUE), np.asarray(image) != image.info.get("transparency", -1)


def _about(path: Path) -> dict[str, Any]:
    """Return the contents of a map file of ROS, checked. Raises MapError."""
    try:
        document = read(path)
        if document.errors:
            raise LabError(document.errors)
    except LabError as error:
        first = error.problems[0]
        raise MapError(str(replace(first, file=path.name))) from None
    about: Any = document.value
    if not isinstance(about, dict) or "image" not in about or "resolution" not in about:
        raise MapError(f"{path.name} is no map file of ROS: it should have the keys image and resolution")
    if unknown := sorted(about.keys() - set(KNOWN)):
        raise MapError(f"{path.name} has the unknown key {unknown[0]}; known are {', '.join(KNOWN)}")
    if not isinstance(about["image"], str):
        raise MapError(f"{path.name}: image should be a file name")
    about = {"negate": 0, "occupied_thresh": OCCUPIED, "free_thresh": FREE, "mode": "trinary", **about}
    for key, least, most in (("resolution", 1e-4, 10.0), ("occupied_thresh", 0.0, 1.0), ("free_thresh", 0.0, 1.0)):
        if not (_number(about[key]) and least <= about[key] <= most):
            raise MapError(f"{path.name}: {key} should be a number from {least:g} to {most:g}, not {about[key]!r}")
    if about["free_thresh"] > about["occupied_thresh"]:
        raise MapError(f"{path.name}: free_thresh should be at most occupied_thresh")
    if (negate := NEGATE.get(str(about["negate"]).lower())) is None:
        raise MapError(f"{path.name}: negate should be 0 or 1, not {about['negate']!r}")
    if str(about["mode"]).lower() not in ("trinary", "scale"):
        raise MapError(f"{path.name}: mode should be trinary or scale, not {about['mode']!r}")
    _check_origin(path, about.get("origin", [0.0, 0.0, 0.0]))
    return {**about, "negate": negate}


def _check_origin(path: Path, origin: object) -> None:
    """Raise MapError unless the origin is three numbers, the last one, an angle, 0."""
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(_number, origin)):
        raise MapError(f"{path.name}: origin should be [x, y, yaw], not {origin!r}")
    if origin[2] != 0:
        raise MapError(f"{path.name}: a yaw of {origin[2]:g} rad is not supported: turn the image")


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
