"""Which escape is taken: the first of the table that is in force, applies and finds room."""

from typing import Final

from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.speed_law import HAZARDS
from rmr.node.motion.standoff.escapes import ESCAPES, Impasse, Manoeuvre


class EscapePolicy:
    """The escapes of one robot that are in force."""

    __slots__ = ("_escapes", "_switches", "chosen")

    def __init__(self, switches: RuleSwitches) -> None:
        self._switches = switches
        self.chosen = ""
        """The name of the escape that was chosen last."""
        self._escapes: Final = [escape for escape in ESCAPES if not switches.off(escape.name)]

    def choose(self, impasse: Impasse) -> Manoeuvre | None:
        """Return the manoeuvre of the first escape that serves; None if none does."""
        for escape in self._escapes:
            manoeuvre = escape.act(impasse) if escape.applies(impasse) else None
            if manoeuvre is not None:
                self._switches.count(escape.name)
                self.chosen = escape.name
                return manoeuvre
        return None


def check_names(without: frozenset[str]) -> None:
    """Raise ValueError if one of the rules to be left out does not exist."""
    known = [rule.name for rule in HAZARDS] + [escape.name for escape in ESCAPES]
    for name in sorted(without):
        if name not in known:
            raise ValueError(f"no rule of motion is called {name!r}; there are {', '.join(known)}")
