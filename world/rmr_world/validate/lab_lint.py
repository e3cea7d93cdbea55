"""Lint of a lab: settings that are valid but can hardly be intended."""

import math
import re
from collections.abc import Iterator

from rmr.base.time import in_seconds
from rmr.bytecode.program import Kind, Program
from rmr.node.config import IN_RANGE_DB
from rmr.radio.phy import NETWORK, path_loss_db
from rmr_world.faults import faults_after_end
from rmr_world.finding import Finding
from rmr_world.lab import Lab


def fault_after_end(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of a fault that begins after the duration."""
    for fault in faults_after_end(lab):
        message = f"{fault} begins when the duration of {in_seconds(lab.duration):g} s is over"
        yield lab.warning(("faults",), message)


def no_localisation(lab: Lab, program: Program) -> Iterator[Finding]:
    """Warn of a localisation service that gives no robot its position although the program drives."""
    # The provided actions that begin only when the robot knows its position.
    drives = [
        p.name
        for p in program.predicates
        if p.kind is Kind.ACTION and p.name in ("moveto", "navigate", "lineup", "goto", "reach")
    ]
    if not drives:
        return
    if len(set(lab.arena.beacons)) < 2:
        key = "beacons"
        why = "that takes two beacons in different places"
    elif lab.localisation.dropout == 1.0:
        key = "dropout"
        why = "all pulses are lost"
    else:
        return
    message = f"no robot will know where it is, and {drives[0]} will never begin: {why}"
    yield lab.warning(("localisation", key), message)


def variable_in_finish(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of a variable in `finish` that has a name: nothing gives it a value, so it matches anything."""
    for word in re.findall(r"\b[A-Z]\w*", re.sub(r'"[^"]*"', "", lab.finish.partition(",")[2])):
        near = [area.name for area in lab.arena.areas if area.name.lower() == word.lower()] if len(word) > 1 else []
        hint = f"did you mean '{near[0]}'?" if near else "write `_` if that is meant"
        yield lab.warning(("finish",), f"{word} is a variable, which matches anything; {hint}")


def heading_beyond_a_turn(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of a robot's heading beyond a full turn: a number without a unit is in radians."""
    for start in lab.robots:
        if abs(start.pose.theta) > 2 * math.pi:
            message = f"robot {start.id} begins with a heading of {start.pose.theta:g} rad, more than a full turn"
            yield lab.warning(("robots",), f"{message}; degrees are written `90deg`")


def unknown_floor(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of cells that the map's saver did not know and that its threshold makes free."""
    if count := lab.map_unknown_free:
        cells = "1 cell" if count == 1 else f"{count} cells"
        message = f"{cells} of grey 205, which map savers write for unknown, are free by the map's free_thresh"
        yield lab.warning(("map",), f"{message}: robots will drive there; with free_thresh: 0.196 they are blocked")


def turns_beyond_the_radio(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of turns on a floor wider than the radio reaches: robots out of range of each other cannot agree on them."""
    arena = lab.arena
    radio = lab.radio.config
    if radio.mode == NETWORK:
        return
    across_m = math.hypot(arena.width, arena.height)
    short_db = radio.sensitivity_dbm - radio.tx_power_dbm + path_loss_db(across_m, radio.exponent)
    if len(lab.robots) < 2 or short_db <= 0.0 or not (arena.passages or arena.stations):
        return
    reach_m = across_m / 10.0 ** (short_db / (10.0 * radio.exponent))
    message = (
        f"this floor is {across_m:.0f} m across, and the radio reaches {reach_m:.0f} m: robots that do not hear each "
        "other may wait for a turn that is long over"
    )
    power = f"tx_power_dbm: {math.ceil(radio.tx_power_dbm + short_db + IN_RANGE_DB)}"
    yield lab.warning(("radio",), f"{message}; `{power}` surely reaches over the whole floor")


CHECKS = (
    unknown_floor,
    fault_after_end,
    no_localisation,
    variable_in_finish,
    heading_beyond_a_turn,
    turns_beyond_the_radio,
)
"""The lint of a lab and its program."""
