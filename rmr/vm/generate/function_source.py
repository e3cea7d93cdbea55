"""Built-in functions as Python source: in place where the arguments' types are known, else the interpreter's own."""

import math
from collections.abc import Callable

from rmr.base.time import NS_PER_S
from rmr.bytecode import functions
from rmr.bytecode.conform import NUMBERS, comparable
from rmr.bytecode.functions import FLOAT_MAX, Function, Gives, Takes
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Type
from rmr.vm.generate.known import BOOL, FLOAT, INT, NOTHING, RESULTS, Known, magnitude, within
from rmr.vm.generate.operators import in_range, kind_of
from rmr.vm.generate.source import DRAWS, Pool, Source, fails, movable

Form = Callable[[Function, list[Source], Pool], Source | None]
"""Writes a function in place for arguments whose types fit; None where it cannot."""

_GIVEN = {
    Gives.INT: Known(INT),
    Gives.FLOAT: Known(FLOAT),
    Gives.BOOL: BOOL,
    Gives.LIST: Known(Type(Base.LIST)),
    Gives.WIDER_LIST: Known(Type(Base.LIST)),
    Gives.ROBOT: Known(Type(Base.ROBOT)),
}

_TAKEN: dict[Takes, tuple[Base, ...]] = {
    Takes.NUMBER: NUMBERS,
    Takes.ROBOT: (Base.ROBOT,),
    Takes.LIST: (Base.LIST,),
    Takes.LIST_OR_STRING: (Base.LIST, Base.STRING),
    Takes.SORTABLE_LIST: (Base.LIST,),
    Takes.POSITION: (Base.INT,),
    Takes.INT: (Base.INT,),
}
"""The types of an argument that fits; an item may be of any."""

SORTABLE = (Base.INT, Base.FLOAT, Base.STRING, Base.SYMBOL, Base.ROBOT)
"""Types of items that `sort` can order among themselves."""


def called(function: Function, args: list[Source], pool: Pool) -> Source:
    """Return a function's value."""
    if function.timed:
        return Source(f"(now / {NS_PER_S})", Known(FLOAT), False)
    if function.drawn:
        return Source(f"{DRAWS}.draw()", _known(function), False)
    form = FORMS[function.source] if function.source and _are_fit(function, args) else None
    written = form and form(function, args, pool)
    return written or _by_function(function, args, pool)


def _are_fit(function: Function, args: list[Source]) -> bool:
    """Return whether all arguments have types that the function takes."""
    wanted = [_TAKEN.get(takes) for takes in function.takes]
    return all(bases is None or arg.known.base in bases for bases, arg in zip(wanted, args, strict=True))


def _known(function: Function) -> Known:
    """Return what is known of a function's value, whatever its arguments."""
    known = _GIVEN.get(function.gives, NOTHING)
    return known if function.bounds is None or known.type is None else within(known.type, function.bounds)


def _by_function(function: Function, args: list[Source], pool: Pool) -> Source:
    """Return a function's value as the interpreter works it out."""
    known = _known(function)
    texts = ", ".join(arg.text for arg in args)
    if not function.numeric:
        return Source(f"{pool.helper(f'{function.name}_of', function.scalar)}({texts})", known, True)
    return Source(f"{pool.helper('call', functions.call)}({function.name!r}, [{texts}], now)", known, True)


def _abs(_function: Function, args: list[Source], pool: Pool) -> Source:
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


def _extreme(sign: str, choose: Callable[..., float]) -> Form:
    """Return how the smaller or larger of two numbers is written; of equal ones it is the first."""

    def written(_function: Function, args: list[Source], pool: Pool) -> Source:
        one, other = args
        left, left_again = pool.held(one)
        right, right_again = pool.held(other)
        text = f"({left_again} if {left} {sign} {right} else {right_again})"
        lows, highs = zip(one.known.bounds, other.known.bounds, strict=True)
        bounds = choose(lows), choose(highs)
        if one.known.base is other.known.base:
            return Source(text, within(kind_of(one, other), bounds), fails(*args))
        return Source(f"float{text}", within(FLOAT, bounds), fails(*args))

    return written


def _floor(function: Function, args: list[Source], pool: Pool) -> Source:
    (arg,) = args
    if arg.known.base is Base.INT:
        return arg
    low, high = map(math.floor, arg.known.bounds)
    return in_range(f"{pool.helper(function.name, function.scalar)}({arg.text})", INT, (low, high), arg, pool=pool)


def _sqrt(function: Function, args: list[Source], pool: Pool) -> Source:
    (arg,) = args
    low, high = arg.known.bounds
    known = within(FLOAT, (math.sqrt(max(low, 0)), math.sqrt(max(high, 0))))
    root = pool.helper(function.name, function.scalar)
    if low >= 0:
        return Source(f"{root}({arg.text})", known, arg.fails)
    first, again = pool.held(arg)
    outside = f"{pool.helper('call', functions.call)}({function.name!r}, [{again}], now)"
    return Source(f"({root}({again}) if {first} >= 0 else {outside})", known, True)


def _total(function: Function, args: list[Source], pool: Pool) -> Source:
    """Write a function that has a value for all numbers."""
    texts = ", ".join(arg.text for arg in args)
    return Source(f"{pool.helper(function.name, function.scalar)}({texts})", _known(function), fails(*args))


def _dist(_function: Function, args: list[Source], pool: Pool) -> Source | None:
    if not movable(*args):
        return None
    x1, y1, x2, y2 = args
    text = f"{pool.helper('hypot', math.hypot)}({x2.text} - {x1.text}, {y2.text} - {y1.text})"
    sides = [RESULTS[Op.SUB](b.known.bounds, a.known.bounds) for a, b in ((x1, x2), (y1, y2))]
    most = math.fsum(abs(bound) for side in sides for bound in side) if _are_finite(sides) else math.inf
    return in_range(text, FLOAT, (0.0, most), *args, pool=pool)


def _are_finite(sides: list[tuple[float, float]]) -> bool:
    return all(abs(bound) <= FLOAT_MAX / 8 for side in sides for bound in side)


def _id(function: Function, args: list[Source], _pool: Pool) -> Source:
    return Source(f"int({args[0].text})", _known(function), args[0].fails)


def _len(_function: Function, args: list[Source], _pool: Pool) -> Source:
    return Source(f"len({args[0].text})", within(INT, args[0].known.bounds), args[0].fails)


def _member(_function: Function, args: list[Source], _pool: Pool) -> Source | None:
    item, items = args
    if item.known.type is None or not comparable(item.known.type, items.known.element):
        return None
    return Source(f"({item.text} in {items.text})", BOOL, fails(*args))


def _sort(_function: Function, args: list[Source], _pool: Pool) -> Source | None:
    (items,) = args
    if items.known.element.base not in SORTABLE:
        return None
    return Source(f"tuple(sorted({items.text}))", items.known, items.fails)


def _nth(function: Function, args: list[Source], pool: Pool) -> Source:
    """Write the item in place where it is certainly there, or the list is at hand to look how long it is."""
    items, place = args
    known = NOTHING if items.known.element.base is Base.OPEN else Known(items.known.element)
    fewest = items.known.bounds[0]
    low, high = place.known.bounds
    if low >= 0 and high < fewest:
        return Source(f"{items.text}[{place.text}]", known, fails(*args))
    return _looked(function, args, ">", "{items}[{place}]", known, pool)


def _rest(function: Function, args: list[Source], pool: Pool) -> Source:
    items, place = args
    fewest, most = items.known.bounds
    low, high = place.known.bounds
    assert items.known.type is not None
    known = within(items.known.type, (max(0, fewest - max(0, high)), most - max(0, low)))
    if low >= 0 and high <= fewest:
        return Source(f"{items.text}[{place.text}:]", known, fails(*args))
    return _looked(function, args, ">=", "{items}[{place}:]", known, pool)


def _looked(function: Function, args: list[Source], sign: str, text: str, known: Known, pool: Pool) -> Source:
    """Return `text` if the list's length compares so with the place."""
    (items, items_again), (place, place_again) = map(pool.held, args)
    found = text.format(place=place_again, items=items_again)
    absent = f"{pool.helper(f'{function.name}_of', function.scalar)}({items_again}, {place_again})"
    return Source(f"({found} if len({items}) {sign} {place} >= 0 else {absent})", known, True)


FORMS: dict[str, Form] = {
    "absolute": _abs,
    "smaller": _extreme("<=", min),
    "larger": _extreme(">=", max),
    "rounded_down": _floor,
    "root": _sqrt,
    "total": _total,
    "distance": _dist,
    "robot_number": _id,
    "length": _len,
    "item": _nth,
    "membership": _member,
    "sorted": _sort,
    "rest": _rest,
}
"""The forms that rows of `FUNCTIONS` name."""
