"""The layout of a machine's state: the attributes that generated code and the runtime share, by name.

The runtime reaches an attribute by its name (``getattr(machine, slots.queue)``), generated code by the expression
``vm.`` and that name. Both ask `RuleSlots` and `PredicateSlots`, so each attribute is named here and nowhere else. The
names of generated functions are in `RuleFunctions` and `PredicateFunctions` for the same reason.
"""

VM = "vm."
"""Prefix under which generated code reaches the machine's attributes."""


class RuleSlots:
    """The attributes in which a machine keeps the matches of one rule; `prefix` begins each of them."""

    def __init__(self, rule: int, prefix: str = "") -> None:
        self.match = f"{prefix}match{rule}"
        """SINGLE: the fact with which the rule fires next; None if there is none."""
        self.queue = f"{prefix}queue{rule}"
        """Facts of the first atom that have not been tried: a list whose first item counts those behind it that have
        been taken already; None if there are none."""
        self.kept = f"{prefix}kept{rule}"
        """JOIN, REMATCH: matches found, each a tuple of facts, the oldest last; None before the first search."""
        self.valued = f"{prefix}valued{rule}"
        """Facts and items that the next match consumes and derives, if heads are evaluated when matches are found."""
        self.current_top = f"{prefix}top{rule}"
        """JOIN: the fact of the first atom below which there may be more matches; None if there is none."""
        self.last_top = f"{prefix}last_top{rule}"
        """JOIN: the serial number of the last fact of the first atom that was tried; 0 before the first."""
        self.joined_up_to = f"{prefix}joined{rule}"
        """JOIN: the serial number up to which new facts of all atoms have been joined."""
        self._new = f"{prefix}new{rule}_"

    def new(self, place: int) -> str:
        """JOIN: the facts of the atom at `place` that have not been joined; None if there are none."""
        return f"{self._new}{place}"


class PredicateSlots:
    """The attributes in which a machine keeps the facts of one predicate."""

    def __init__(self, predicate: int) -> None:
        self.table = f"facts{predicate}"
        """The facts that hold: a dict, or, of a predicate whose facts stand in queues, a list of the others."""
        self._index = f"index{predicate}_"

    def index(self, number: int) -> str:
        """An index of the table; None before it is first probed."""
        return f"{self._index}{number}"


class RuleFunctions:
    """The generated functions of one rule."""

    def __init__(self, rule: int) -> None:
        self.find = f"find{rule}"
        """Looks for the match with which the rule fires next."""
        self.fire = f"fire{rule}"
        """Fires the rule; only in programs with many rules."""
        self.fire_all = f"fire_all{rule}"
        """JOIN: fires the rule for all matches of the facts that are still to be tried, while it alone is satisfied."""
        self.below = f"below{rule}"
        """JOIN: looks for matches with a given fact of the first atom."""
        self.restart = f"restart{rule}"
        """JOIN: lets all facts of the first atom be tried again."""
        self.each = f"each{rule}"
        """Yields all matches as the specification does."""
        self.derive = f"derive{rule}"
        """Works out what a match consumes and derives, for `Running.apply`."""
        self.value = f"value{rule}"
        """Works out what a match derives, for the generated run loop."""
        self._fresh = f"fresh{rule}_"

    def fresh(self, place: int) -> str:
        """JOIN: looks for matches with a new fact of the atom at `place`."""
        return f"{self._fresh}{place}"


class PredicateFunctions:
    """The generated functions of one predicate."""

    def __init__(self, predicate: int) -> None:
        self.add = f"add{predicate}"
        """Inserts a fact."""
        self.remove = f"remove{predicate}"
        """Removes a fact."""
        self.several = f"several{predicate}"
        """Inserts many facts."""
        self.arrive = f"arrive{predicate}"
        """Checks a fact from outside and inserts it."""
