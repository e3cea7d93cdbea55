"""Names of the functions that are generated from a program (`rmr.vm.generate`), as a state that holds them tells them.

A match may wait with the function that inserts what it derives. Such a function is made at its first use, and has a
placeholder before: both have one name, and do the same.
"""

from typing import Any


class GeneratedFunctions:
    """The generated functions of one machine's program; of an interpreted one there are none."""

    def __init__(self, machine: object) -> None:
        module: Any = getattr(type(machine), "module", None)
        self._names: dict[str, Any] = {} if module is None else module.names

    def name_of(self, function: Any) -> str | None:
        """Return the name of a generated function, or of its placeholder; None for another one."""
        # The placeholder of a function that has not been used.
        if function.__qualname__ == "Module._first.<locals>.first":
            held = dict(zip(function.__code__.co_freevars, function.__closure__, strict=True))
            name = str(held["name"].cell_contents)
        elif function.__globals__ is self._names:
            name = function.__name__
        else:
            return None
        return name if name in self._names else None

    def function(self, name: str) -> Any:
        """Return the function of that name, or its placeholder; None if the program has none."""
        return self._names.get(name)
