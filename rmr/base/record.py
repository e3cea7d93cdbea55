"""Records: classes like `@dataclass(frozen=True, slots=True)`, faster to define and to construct.

A command that runs for half a second would spend a tenth of it on defining classes; and of compiling thousands of
lines, most time goes into constructing nodes. So what a run loads uses records, except the modules that are compiled
(`rmr.compiled`): mypyc knows dataclasses alone. The class of a record is defined with one `exec` instead of seven, and
its constructor is plain assignment: immutability is checked by the type checker alone. The functions of `dataclasses`
(`replace`, `fields`, ...) accept records.
"""

from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from operator import attrgetter
from typing import Any, TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass
class _Pattern:
    slot: object


[_PATTERN] = fields(_Pattern)


@dataclass_transform(frozen_default=True)
def record(cls: type[T]) -> type[T]:
    """Return `cls` as a record: a slot for each annotation, in their order, and equality by all slots."""
    names = tuple(cls.__annotations__)
    defaults = {name: cls.__dict__[name] for name in names if name in cls.__dict__}
    own = {key: value for key, value in cls.__dict__.items() if key not in {*names, "__dict__", "__weakref__"}}
    values = attrgetter(*names) if names else _nothing
    # `dataclasses` finds the fields of a class there.
    made = {
        "__slots__": names,
        "__match_args__": names,
        "__init__": _initialiser(names, defaults),
        "__eq__": lambda self, other: (
            values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented
        ),
        "__hash__": lambda self: values(self).__hash__(),
        "__repr__": _shown,
        "__dataclass_fields__": {name: _field(name, kind) for name, kind in cls.__annotations__.items()},
    }
    again: type[T] = type(cls.__name__, cls.__bases__, own | made)
    return again


def _initialiser(names: tuple[str, ...], defaults: dict[str, Any]) -> Callable[..., None]:
    parameters = [f"{name}=defaults[{name!r}]" if name in defaults else name for name in names]
    assignments = "".join(f"\n    self.{name} = {name}" for name in names) or "\n    pass"
    made: dict[str, Any] = {"defaults": defaults}
    exec(f"def __init__({', '.join(['self', *parameters])}):{assignments}", made)
    initialiser: Callable[..., None] = made["__init__"]
    return initialiser


def _field(name: str, kind: Any) -> Field[Any]:
    """Return the descriptor of a field for `dataclasses`."""
    made: Field[Any] = Field(MISSING, MISSING, True, True, None, True, {}, False)  # type: ignore[arg-type]
    made.name = name
    made.type = kind
    made._field_type = _PATTERN._field_type  # type: ignore[attr-defined]
    return made


def _nothing(_: object) -> tuple[()]:
    return ()


def _shown(self: Any) -> str:
    inside = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.__match_args__)
    return f"{type(self).__qualname__}({inside})"
