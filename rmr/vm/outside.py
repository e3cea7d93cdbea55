"""Input validation: the types of facts, goals and actions from sensors, other robots, operators and Python actions.

A program's own facts are checked when it is compiled and verified. Input from outside is checked here, so the machine
never stores a value that its predicate does not declare. An int where a float is declared is converted. Any other
mismatch is the caller's mistake (ValueError).
"""

from collections.abc import Callable, Sequence

from rmr.base.values import Value
from rmr.bytecode.conform import checker, conforms
from rmr.bytecode.program import ANY, GOALS_OF, Anything, Base, Constant, Kind, Pattern, Predicate, Slot, Type
from rmr.vm.store import Args


class Gate:
    """Checks arguments against the declared types."""

    __slots__ = ("_facts", "_fits", "_predicates")

    def __init__(self, predicates: Sequence[Predicate]) -> None:
        self._predicates = predicates
        self._fits = [_fits(predicate.types) for predicate in predicates]
        self._facts = [
            _refuse if predicate.kind is Kind.ACTION or predicate.name.startswith(GOALS_OF) else fits
            for predicate, fits in zip(predicates, self._fits, strict=True)
        ]
        """By predicate, whether arguments conform as they are: the fast path of every fact that comes in."""

    def fact(self, predicate: int, args: Args) -> Args:
        """Return the arguments of a fact. Raises ValueError."""
        if 0 <= predicate < len(self._facts) and self._facts[predicate](args):
            return args
        declared = self._predicate(predicate)
        if declared.kind is Kind.ACTION:
            raise ValueError(f"{declared.name} is an action, not a fact")
        if declared.name.startswith(GOALS_OF):
            raise ValueError(f"{declared.name} stands for goals: they are opened, not inserted")
        return self._convert(predicate, declared, args)

    def sensed(self, predicate: int, args: Args) -> Args:
        """Return the arguments of a sensed fact. Raises ValueError."""
        declared = self._predicate(predicate)
        if declared.kind is not Kind.SENSED or declared.name.startswith(GOALS_OF):
            raise ValueError(f"{declared.name} is not sensed: its facts cannot be withdrawn")
        return self._convert(predicate, declared, args)

    def action(self, predicate: int, args: Args) -> Args:
        """Return the arguments of an action. Raises ValueError."""
        declared = self._predicate(predicate)
        if declared.kind is not Kind.ACTION:
            raise ValueError(f"{declared.name} is no action")
        return self._convert(predicate, declared, args)

    def goal(self, predicate: int, args: Sequence[Value | Pattern]) -> tuple[Anything | Constant, ...]:
        """Return the patterns of a goal. Raises ValueError."""
        declared = self._predicate(predicate)
        if declared.kind is Kind.ACTION:
            raise ValueError(f"{declared.name} is an action, not a goal")
        if len(args) != len(declared.types):
            raise _arity(declared, len(args))
        patterns: list[Anything | Constant] = []
        for position, (arg, kind) in enumerate(zip(args, declared.types, strict=True)):
            if isinstance(arg, Slot | Anything):  # the slots of another robot's rule mean nothing here
                patterns.append(ANY)
            else:
                value = arg.value if isinstance(arg, Constant) else arg
                patterns.append(Constant(_value(declared, position, kind, value)))
        return tuple(patterns)

    def _predicate(self, index: int) -> Predicate:
        if not 0 <= index < len(self._predicates):
            raise ValueError(f"there is no predicate {index}")
        return self._predicates[index]

    def _convert(self, predicate: int, declared: Predicate, args: Args) -> Args:
        if self._fits[predicate](args):
            return args
        if len(args) != len(declared.types):
            raise _arity(declared, len(args))
        return tuple([_value(declared, i, kind, args[i]) for i, kind in enumerate(declared.types)])


def _refuse(_: Args) -> bool:
    return False


def _fits(types: Sequence[Type]) -> Callable[[Args], bool]:
    """Return the predicate "arguments are of `types`, without a conversion"."""
    fits = [checker(kind) for kind in types]
    count = len(fits)
    if count == 0:
        return lambda args: not args
    # One and two arguments, by far the most frequent, are checked without a generator.
    first = fits[0]
    second = fits[-1]
    if count == 1:
        return lambda args: len(args) == 1 and first(args[0])
    if count == 2:
        return lambda args: len(args) == 2 and first(args[0]) and second(args[1])
    return lambda args: len(args) == count and all(fit(value) for fit, value in zip(fits, args, strict=True))


def _arity(declared: Predicate, count: int) -> ValueError:
    return ValueError(f"{declared.name} has {len(declared.types)} arguments without its owner, not {count}")


def _value(declared: Predicate, position: int, kind: Type, value: Value) -> Value:
    """Return `value` as the declared type. Raises ValueError."""
    value = _with_floats(kind, value)
    if not conforms(value, kind):
        wanted = kind.name or kind.base.name.lower()
        raise ValueError(f"argument {position + 2} of {declared.name} is {value!r}, which is no {wanted}")
    return value


def _with_floats(kind: Type, value: Value) -> Value:
    """Return `value` with each int converted to float where `kind` declares a float, inside nested lists too."""
    if kind.base is Base.LIST and kind.element is not None and type(value) is tuple:
        return tuple([_with_floats(kind.element, item) for item in value])
    if kind.base is not Base.FLOAT or type(value) is not int:
        return value
    try:
        return float(value)
    except OverflowError:
        return value  # an int beyond the floats: the caller reports it as of the wrong type
