"""Checks of the large records in messages: the floor and the radio of a `Map`, the report of a `Status`.

A map that passes describes a possible floor and radio; whether they fit its program is checked by the robot. What the
launcher reads of a report has its type; fields that it does not know are plain data and pass. Texts in a report are
those of the program's facts and stay as they are: who shows them makes them printable.
"""

from typing import Any, Final

from rmr.base import arena
from rmr.base.arena import Arena, Disc, RobotShape
from rmr.base.direction import ENDS_MAX
from rmr.base.geometry import Point
from rmr.bus.checks import (
    Check,
    MalformedError,
    by_name,
    count,
    each,
    fields,
    flag,
    group,
    integer,
    name,
    number,
    optional,
    people,
    record,
    robot,
    text,
)
from rmr.radio.phy import Bursts, RadioConfig
from rmr.radio.settings import SETTINGS

FLOOR_M_MAX: Final = 1000.0
CELLS_MAX: Final = 1_000_000
"""Cells of the planning grid, at most: four times the limit of a lab file."""
PLACES_MAX: Final = 100_000
"""Places, corners and beacons of one floor, at most: more than a lab file can hold."""
BEACONS_MAX: Final = 16
ENERGY_DB_MAX: Final = 200.0
"""Greatest distance of the energy threshold from the sensitivity, either way."""
OWN: Final = frozenset({"pan", "seed", "security"})
"""Entries of the radio's record that are not settings of its model."""


def floor(value: Any) -> dict[str, Any]:
    """Accept the record of an arena (`rmr.base.arena.to_data`)."""
    data = record(value)
    try:
        _check_floor(arena.from_data(data))
    except MalformedError:
        raise
    except Exception as error:  # of whatever kind: the record is of another form
        raise MalformedError(f"expected an arena: {type(error).__name__}") from None
    return data


def _check_floor(floor: Arena) -> None:
    _within(floor.width, 0.001, FLOOR_M_MAX)
    _within(floor.height, 0.001, FLOOR_M_MAX)
    _within(floor.cell, 0.001, FLOOR_M_MAX)
    if floor.width / floor.cell * (floor.height / floor.cell) > CELLS_MAX:
        raise MalformedError("expected an arena with fewer cells")
    _check_shape(floor.shape)
    _within(floor.range_sigma, 0.0, FLOOR_M_MAX)
    points = [*floor.beacons]
    for obstacle in floor.obstacles:
        if isinstance(obstacle, Disc):
            _within(obstacle.radius, 0.0, FLOOR_M_MAX)
            points.append(obstacle.centre)
        elif len(obstacle.corners) < 3:
            raise MalformedError("expected an obstacle with three corners")
        else:
            points += obstacle.corners
    for area in floor.areas:
        name(area.name)
        if not area.places or type(area.slotted) is not bool:
            raise MalformedError("expected an area with places")
        points += [*area.places, *area.queue]
        if area.box is not None:
            points += [Point(*area.box[:2]), Point(*area.box[2:])]
    points += [mouth for passage in floor.passages for mouth in passage.mouths]
    if len(floor.beacons) > BEACONS_MAX or len(points) > PLACES_MAX:
        raise MalformedError("expected an arena with fewer places")
    for point in points:
        _within(point.x, -FLOOR_M_MAX, 2 * FLOOR_M_MAX)
        _within(point.y, -FLOOR_M_MAX, 2 * FLOOR_M_MAX)
    for passage in floor.passages:
        name(passage.name)
        if not 1 <= len(passage.entrances) <= ENDS_MAX:
            raise MalformedError(f"expected a passage with one entrance or up to {ENDS_MAX}")


def _check_shape(shape: RobotShape) -> None:
    for value in (shape.radius, shape.speed, shape.turn):
        _within(value, 1e-6, FLOOR_M_MAX)
    _within(shape.view_angle, 0.0, 10.0)
    _within(shape.view_depth, 0.0, FLOOR_M_MAX)


def _within(value: Any, least: float, most: float) -> None:
    if not least <= number(value) <= most:
        raise MalformedError(f"expected a number from {least:g} to {most:g}")


def radio(value: Any) -> dict[str, Any]:
    """Accept the record of the radio's settings."""
    data = record(value)
    settings = {key: item for key, item in data.items() if key not in OWN}
    try:
        if settings.get("bursts") is not None:
            settings["bursts"] = Bursts(**settings["bursts"])
        _check_radio(RadioConfig(**settings))
    except MalformedError:
        raise
    except Exception as error:
        raise MalformedError(f"expected a radio's settings: {type(error).__name__}") from None
    pan = data.get("pan")
    seed = data.get("seed")
    if type(pan) is not int or not 0 <= pan < 0xFFFF or type(seed) is not int:
        raise MalformedError("expected a radio's PAN and seed")
    if type(data.get("security", "")) is not str:
        raise MalformedError("expected the name of a level of security")
    return data


def _check_radio(config: RadioConfig) -> None:
    for setting in SETTINGS:
        if setting.limits is not None:
            _within(getattr(config, setting.name), *setting.limits)
    _within(config.energy_threshold_db, -ENERGY_DB_MAX, ENERGY_DB_MAX)
    if config.bursts is not None and not (type(config.bursts.good) is type(config.bursts.bad) is int):
        raise MalformedError("expected bursts in nanoseconds")


# --- the report of a robot or the world in a Status

_JOB: Final = fields(
    {
        "name": text,
        "job": text,
        "start_s": number,
        "finish_s": optional(number),
        "deadline_s": number,
        "met": optional(flag),
    },
    {"cause": optional(text)},
)

PART: Final[dict[str, Check]] = {
    "finish_s": optional(number),
    "distance_m": number,
    "assertions": each(_JOB),
    "facts": each(text),
    "goals": fields({"achieved": each(group(text, number)), "open": each(text)}),
    "actions": each(group(number, text)),
    "restarts": count,
    "unsaved": count,
    "resumed": flag,
    "expression_failures": count,
    "undelivered": count,
    "unsendable": count,
    "frames": by_name(count),
    "ticks": count,
    "ticks_late": count,
    "tasks_skipped": count,
    "schedules": each(
        fields({"event": text, "leader": robot, "term": count, "order": each(robot), "formed_s": number})
    ),
    "bus": fields({}, {"lost": count, "malformed": count, "excess": each(group(integer, count))}),
    "left_out": each(text),
    "log_cut_short": people,
    "late_samples": count,
    "off_m": optional(number),
    "estimates_dropped": count,
    "samples_refused": count,
    "late_commands": each(group(robot, count, number)),
    "faults": each(fields({"from": number}, {"to": number})),
}
"""Checks of the fields of a part, by name; other fields may be any plain data."""

report: Final = fields({}, PART)
"""Accepts a part of the report."""
