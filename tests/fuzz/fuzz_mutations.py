"""Damages byte-code: octets at random, and programs part by part.

Octets are damaged as transmission, storage or malice would, with size and CRC-32 made right again in most cases:
else the CRC would find everything and nothing behind it would be tested. Programs are damaged by putting a part
of one in the place of another part of its kind, and written without being verified.
"""

import struct
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from enum import IntEnum
from random import Random

from rmr.base.values import Robot, Symbol
from rmr.bytecode.encoder import encode_tables
from rmr.bytecode.layout import (
    CRC_OFFSET,
    FLAG_DEBUG,
    FLAG_ENSEMBLE,
    FLAG_TEXTUAL,
    HEADER,
    TABLES,
    assemble,
    checksum,
    read_layout,
)
from rmr.bytecode.octets import BytecodeError, Writer
from rmr.bytecode.program import (
    Aggregate,
    Anything,
    Atom,
    Bind,
    Comprehension,
    Constant,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Guard,
    Instruction,
    Program,
    Slot,
    Steps,
    Strategy,
)

VARINTS = [0, 1, 0x7F, 0x80, 1 << 32, (1 << 63) - 1, (1 << 64) - 1, 1 << 69]
"""Numbers at the edges."""

INTS = [0, 1, 2, 3, 5, 11, 12, 1023, 1024, 65533, 65534, 1 << 31, 1 << 60]

FAMILIES: list[tuple[type, ...]] = [
    (Anything, Slot, Constant),
    (Atom, Guard, Bind),
    (DeriveFact, DeriveGoal, DeriveAction, Comprehension, Aggregate, Steps),
]
"""Kinds that may stand in each other's place."""

Path = tuple[str | int, ...]
Part = tuple[Path, object]
"""A part of a program and the way to it: fields and places."""


def resealed(octets: bytearray) -> bytes:
    """Return a file with its size and CRC-32 made right."""
    if len(octets) < HEADER.size:
        return bytes(octets)
    octets[6:CRC_OFFSET] = len(octets).to_bytes(4, "little")
    octets[CRC_OFFSET : HEADER.size] = checksum(bytes(octets)).to_bytes(4, "little")
    return bytes(octets)


# ---- octets


def random_octets(rng: Random) -> bytes:
    """Return octets of chance, mostly behind a proper header."""
    octets = rng.randbytes(rng.choice([0, 3, 20, 100, 400]))
    if rng.random() < 0.2:
        return octets
    directory = bytes(rng.choice([0, 0, 1, 2, 5, rng.randrange(256)]) for _ in range(2 * len(TABLES)))
    return resealed(bytearray(HEADER.pack(b"RMR\x1a", 2, rng.choice([0, 0, 1, 2, 3, 4, 7]), 0, 0) + directory + octets))


def damaged(rng: Random, data: bytes, other: bytes) -> bytes:
    """Return `data` with its octets damaged; `other` is what may be spliced in."""
    octets = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        rng.choice(DAMAGES)(rng, octets, other)
    return resealed(octets) if rng.random() < 0.9 else bytes(octets)


def damaged_table(rng: Random, data: bytes, other: bytes) -> bytes:
    """Return `data` with the octets of one table damaged, and a directory that fits."""
    layout = read_layout(data)
    tables = {name: (count, data[start:end]) for name, (count, start, end) in layout.tables.items()}
    name = rng.choice([name for name in tables if tables[name][1]] or list(TABLES))
    octets = bytearray(tables[name][1])
    rng.choice(DAMAGES)(rng, octets, other)
    tables[name] = (max(0, tables[name][0] + rng.choice([0, 0, 0, -1, 1])), bytes(octets))
    return assemble(layout.flags, tables)


def _place(rng: Random, octets: bytearray) -> int:
    return rng.randrange(len(octets)) if octets else 0


def _flip(rng: Random, octets: bytearray, other: bytes) -> None:
    for _ in range(rng.choice([1, 1, 2, 8])):
        if octets:
            octets[_place(rng, octets)] ^= 1 << rng.randrange(8)


def _substitute(rng: Random, octets: bytearray, other: bytes) -> None:
    for _ in range(rng.choice([1, 1, 2, 4])):
        if octets:
            octets[_place(rng, octets)] = rng.choice([0, 1, 2, 3, 0x7F, 0x80, 0xFF, rng.randrange(256)])


def _truncate(rng: Random, octets: bytearray, other: bytes) -> None:
    del octets[_place(rng, octets) :]


def _splice(rng: Random, octets: bytearray, other: bytes) -> None:
    octets[_place(rng, octets) :] = other[rng.randrange(len(other)) :]


def _duplicate(rng: Random, octets: bytearray, other: bytes) -> None:
    start = _place(rng, octets)
    part = octets[start : start + rng.choice([1, 2, 3, 5, 12, 40])]
    octets[start:start] = part * rng.choice([1, 1, 2, 10])


def _delete(rng: Random, octets: bytearray, other: bytes) -> None:
    start = _place(rng, octets)
    del octets[start : start + rng.choice([1, 1, 2, 3, 12])]


def _insert_number(rng: Random, octets: bytearray, other: bytes) -> None:
    writer = Writer()
    writer.varint(rng.choice(VARINTS))
    start = _place(rng, octets)
    octets[start : start + rng.choice([0, 1])] = writer.octets


DAMAGES: list[Callable[[Random, bytearray, bytes], None]] = [
    _flip,
    _flip,
    _substitute,
    _substitute,
    _truncate,
    _splice,
    _duplicate,
    _delete,
    _insert_number,
]


# ---- programs


def parts(thing: object, path: Path = ()) -> list[Part]:
    """Return everything that a program is made of."""
    found: list[Part] = [(path, thing)]
    if is_dataclass(thing) and not isinstance(thing, type):
        for each in fields(thing):
            found += parts(getattr(thing, each.name), (*path, each.name))
    elif type(thing) is tuple:
        for index, item in enumerate(thing):
            found += parts(item, (*path, index))
    return found


def put(thing: object, path: Path, new: object) -> object:
    """Return `thing` with `new` in the place of the part at `path`."""
    if not path:
        return new
    step = path[0]
    if isinstance(step, str):
        return replace(thing, **{step: put(getattr(thing, step), path[1:], new)})  # type: ignore[type-var]
    assert type(thing) is tuple
    return (*thing[:step], put(thing[step], path[1:], new), *thing[step + 1 :])


def restructured(rng: Random, own: list[Part], others: list[Part]) -> bytes | None:
    """Return the octets of a program, given its parts, with some changed; None if they cannot be written.

    `others` are parts of any programs, to put in the place of its own.
    """
    changed = own[0][1]
    for number in range(rng.choice([1, 1, 1, 2, 3])):
        path, part = rng.choice(parts(changed) if number else own)
        changed = put(changed, path, _changed(rng, part, others))
    return _written(changed) if isinstance(changed, Program) else None


UNWRITABLE = (
    *(AssertionError, AttributeError, TypeError, ValueError, KeyError, OverflowError, struct.error),
    BytecodeError,
)
"""What comes of a program that octets could not say, or no file could hold."""


def _written(program: Program) -> bytes | None:
    flags = FLAG_TEXTUAL if program.strategy is Strategy.TEXTUAL else 0
    try:
        flags |= (FLAG_DEBUG if program.debug else 0) | (FLAG_ENSEMBLE if program.ensemble else 0)
        return assemble(flags, encode_tables(program, debug=True))
    except UNWRITABLE:
        return None


def _changed(rng: Random, part: object, others: list[Part]) -> object:
    """Return something in the place of `part`."""
    if type(part) is tuple and rng.random() < 0.7:
        return _reordered(rng, part)
    if isinstance(part, IntEnum):
        return rng.choice(list(type(part)))
    if type(part) is int:
        return rng.choice([part + 1, part - 1, rng.choice(INTS)])
    if type(part) is bool:
        return not part
    if type(part) in (str, Symbol):
        return type(part)(rng.choice(["", "Upper", "a b", "\x1b", "x" * 70000, f"{part}x"]))
    if type(part) is Robot:
        return Robot(rng.choice([0, 1, 7, 65533]))
    if isinstance(part, Instruction) and rng.random() < 0.5:
        return replace(part, op=rng.choice(list(type(part.op))))
    family = next((each for each in FAMILIES if type(part) in each), (type(part),))
    alike = [other for _, other in rng.choices(others, k=200) if type(other) in family]
    return rng.choice(alike) if alike else part


def _reordered(rng: Random, part: tuple[object, ...]) -> tuple[object, ...]:
    """Return a sequence with an item more or less, or in another order."""
    items = list(part)
    which = rng.randrange(4)
    if not items:
        return part
    if which == 0:
        del items[rng.randrange(len(items))]
    elif which == 1:
        items.insert(rng.randrange(len(items) + 1), rng.choice(items))
    elif which == 2:
        rng.shuffle(items)
    else:
        items = items * rng.choice([2, 2, 3, 300])
    return tuple(items)
