"""Built-in functions as Python source: in place where the arguments' types are known, else the interpreter's own."""

import math
from collections.abc import Callable

from rmr.base.time import NS_PER_S
from rmr.base.values import ROBOT_ID_MAX
from rmr.bytecode import functions
from rmr.bytecode.conform import LENGTH_MAX
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Type
from rmr.vm.generate.known import BOOL, FLOAT, FLOAT_MAX, INT, NOTHING, NUMBERS, Known, comparable, within
from rmr.vm.generate.operators import in_range, kind_of
from rmr.vm.generate.ranges import RESULTS, magnitude
from rmr.vm.generate.source import Pool, Source, fails, movable

RESULT_TYPES: dict[str, Known] = {
    "sqrt": within(FLOAT, (0, FLOAT_MAX)),
    "sin": within(FLOAT, (-1, 1)),
    "cos": within(FLOAT, (-1, 1)),
    "atan2": within(FLOAT, (-4, 4)),
    "dist": within(FLOAT, (0, FLOAT_MAX)),
    "floor": Known(INT),
    "id": within(INT, (0, ROBOT_ID_MAX)),
    "len": within(INT, (0, LENGTH_MAX)),
    "member": BOOL,
    "sort": Known(Type(Base.LIST)),
    "rest": Known(Type(Base.LIST)),
}
"""What is known of a function's value, whatever its arguments."""

SORTABLE = (Base.INT, Base.FLOAT, Base.STRING, Base.SYMBOL, Base.ROBOT)
"""Types of items that `sort` can order among themselves."""


def called(name: str, args: list[Source], pool: Pool) -> Source:
    """Return a function's value."""
    if name == "now":
        return Source(f"(now / {NS_PER_S})", Known(FLOAT), False)
    written = _IN_PLACE[name](args, pool) if _are_fit(name, args) else None
    return written or _by_function(name, args, pool)


def _are_fit(name: str, args: list[Source]) -> bool:
    """Tell whether all arguments have types that the function takes."""
    bases = [arg.known.base for arg in args]
    if name in functions.NUMERIC:
        return all(base in NUMBERS for base in bases)
    if name == "id":
        return bases == [Base.ROBOT]
    if name == "len":
        return bases[0] in (Base.LIST, Base.STRING)
    if name == "member":
        return bases[1] is Base.LIST
    return bases in ([Base.LIST], [Base.LIST, Base.INT])


def _by_function(name: str, args: list[Source], pool: Pool) -> Source:
    """Return a function's value as the interpreter works it out."""
    known = RESULT_TYPES.get(name, NOTHING)
    texts = ", ".join(arg.text for arg in args)
    if name in functions.OTHERS:
        return Source(f"{pool.helper(f'{name}_of', functions.OTHERS[name])}({texts})", known, True)
    return Source(f"{pool.helper('call', functions.call)}({name!r}, [{texts}], now)", known, True)


def _abs(args: list[Source], pool: Pool) -> Source:
    (arg,) = args
    known = arg.known
    assert known.type is not None
    if known.base is Base.FLOAT:
        return Source(f"abs({arg.text})", within(FLOAT, magnitude(known.bounds)), arg.fails)
    if known.bounds[0] >= 0:
        return arg
    first, again = pool.held(arg)
    negated = in_range(f"-{again}", INT, (0, -known.bounds[0]), pool=pool)
    text = f"({negated.text} if {first} < 0 else {again})"
    return Source(text, within(INT, magnitude(known.bounds)), arg.fails or negated.fails)


def _extreme(sign: str, choose: Callable[..., float]) -> Callable[[list[Source], Pool], Source]:
    """Return how the smaller or larger of two numbers is written; of equal ones it is the first."""

    def written(args: list[Source], pool: Pool) -> Source:
        one, other = args
        (left, left_again), (right, right_again) = pool.held(one), pool.held(other)
        text = f"({left_again} if {left} {sign} {right} else {right_again})"
        lows, highs = zip(one.known.bounds, other.known.bounds, strict=True)
        bounds = choose(lows), choose(highs)
        if one.known.base is other.known.base:
            return Source(text, within(kind_of(one, other), bounds), fails(*args))
        return Source(f"float{text}", within(FLOAT, bounds), fails(*args))

    return written


def _floor(args: list[Source], pool: Pool) -> Source:
    (arg,) = args
    if arg.known.base is Base.INT:
        return arg
    low, high = map(math.floor, arg.known.bounds)
    return in_range(f"{pool.helper('floor', math.floor)}({arg.text})", INT, (low, high), arg, pool=pool)


def _sqrt(args: list[Source], pool: Pool) -> Source:
    (arg,) = args
    low, high = arg.known.bounds
    known = within(FLOAT, (math.sqrt(max(low, 0)), math.sqrt(max(high, 0))))
    root = pool.helper("sqrt", math.sqrt)
    if low >= 0:
        return Source(f"{root}({arg.text})", known, arg.fails)
    first, again = pool.held(arg)
    outside = f"{pool.helper('call', functions.call)}('sqrt', [{again}], now)"
    return Source(f"({root}({again}) if {first} >= 0 else {outside})", known, True)


def _total(name: str, function: Callable[..., float]) -> Callable[[list[Source], Pool], Source]:
    """Return how a function is written that has a value for all numbers."""

    def written(args: list[Source], pool: Pool) -> Source:
        texts = ", ".join(arg.text for arg in args)
        return Source(f"{pool.helper(name, function)}({texts})", RESULT_TYPES[name], fails(*args))

    return written


def _dist(args: list[Source], pool: Pool) -> Source | None:
    if not movable(*args):
        return None
    x1, y1, x2, y2 = args
    text = f"{pool.helper('hypot', math.hypot)}({x2.text} - {x1.text}, {y2.text} - {y1.text})"
    sides = [RESULTS[Op.SUB](b.known.bounds, a.known.bounds) for a, b in ((x1, x2), (y1, y2))]
    most = math.fsum(abs(bound) for side in sides for bound in side) if _are_finite(sides) else math.inf
    return in_range(text, FLOAT, (0.0, most), *args, pool=pool)


def _are_finite(sides: list[tuple[float, float]]) -> bool:
    return all(abs(bound) <= FLOAT_MAX / 8 for side in sides for bound in side)


def _id(args: list[Source], _pool: Pool) -> Source:
    return Source(f"int({args[0].text})", RESULT_TYPES["id"], args[0].fails)


def _len(args: list[Source], _pool: Pool) -> Source:
    return Source(f"len({args[0].text})", within(INT, args[0].known.bounds), args[0].fails)


def _member(args: list[Source], _pool: Pool) -> Source | None:
    item, items = args
    if item.known.type is None or not comparable(item.known.type, items.known.element):
        return None
    return Source(f"({item.text} in {items.text})", BOOL, fails(*args))


def _sort(args: list[Source], _pool: Pool) -> Source | None:
    (items,) = args
    if items.known.element.base not in SORTABLE:
        return None
    return Source(f"tuple(sorted({items.text}))", items.known, items.fails)


def _nth(args: list[Source], pool: Pool) -> Source:
    """Write the item in place where it is certainly there, or the list is at hand to look how long it is."""
    items, place = args
    known = NOTHING if items.known.element.base is Base.OPEN else Known(items.known.element)
    (fewest, _), (low, high) = items.known.bounds, place.known.bounds
    if low >= 0 and high < fewest:
        return Source(f"{items.text}[{place.text}]", known, fails(*args))
    return _looked(args, ">", "{items}[{place}]", "nth", known, pool)


def _rest(args: list[Source], pool: Pool) -> Source:
    items, place = args
    (fewest, most), (low, high) = items.known.bounds, place.known.bounds
    assert items.known.type is not None
    known = within(items.known.type, (max(0, fewest - max(0, high)), most - max(0, low)))
    if low >= 0 and high <= fewest:
        return Source(f"{items.text}[{place.text}:]", known, fails(*args))
    return _looked(args, ">=", "{items}[{place}:]", "rest", known, pool)


def _looked(args: list[Source], sign: str, text: str, name: str, known: Known, pool: Pool) -> Source:
    """Return `text` if the list's length compares so with the place."""
    (items, items_again), (place, place_again) = map(pool.held, args)
    found = text.format(place=place_again, items=items_again)
    absent = f"{pool.helper(f'{name}_of', functions.OTHERS[name])}({items_again}, {place_again})"
    return Source(f"({found} if len({items}) {sign} {place} >= 0 else {absent})", known, True)


_IN_PLACE: dict[str, Callable[[list[Source], Pool], Source | None]] = {
    "abs": _abs,
    "min": _extreme("<=", min),
    "max": _extreme(">=", max),
    "floor": _floor,
    "sqrt": _sqrt,
    "sin": _total("sin", math.sin),
    "cos": _total("cos", math.cos),
    "atan2": _total("atan2", math.atan2),
    "dist": _dist,
    "id": _id,
    "len": _len,
    "nth": _nth,
    "member": _member,
    "sort": _sort,
    "rest": _rest,
}
