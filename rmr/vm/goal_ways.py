"""Shortest ways to goals over the facts that hold: exploration of the graph of regressions (`rmr.vm.goal_graph`).

The graph is explored backwards from the goals, nearest first (`rmr.analysis.regressions`), and kept: steps are added
and removed as facts come and go. A new fact is joined with the other side facts of every rule that reads it, for the
nodes explored before.

Work is bounded: `work` spends a budget of steps and is resumed where it was interrupted. Meanwhile levels up to `exact`
are final and all other ones are unknown.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator

from rmr.analysis.backward_chaining import Patterns, numbered, resolved
from rmr.analysis.goal_levels import EDGES_MAX
from rmr.analysis.regressions import AbsentAtom, ChainOption, Check, Comparison, Regression, Regressions, Row, Terms
from rmr.base.values import Robot, Value
from rmr.bytecode.program import ANY, SELF_SLOT, Anything, Constant, Pattern, Slot
from rmr.vm.evaluate import NoValue, evaluate
from rmr.vm.goal_graph import FAR, FactKey, GoalGraph, GroundStep, WantedFact
from rmr.vm.side_facts import Env, SideFacts, has_twins, is_known, matches, probe, undo
from rmr.vm.store import Args

CHANGES_MAX = 100_000
"""Changes of facts that may wait to be applied; beyond that the graph is dropped, for it costs less to begin anew."""


class SideUse:
    """The place of a side atom in a regression."""

    __slots__ = ("option", "place", "regression", "which")

    def __init__(self, which: int, regression: Regression, option: int, place: int) -> None:
        self.which = which
        """Place of the regression among those of its predicate."""
        self.regression = regression
        self.option = option
        self.place = place


class GoalWays(GoalGraph):
    """The graph of one robot."""

    def __init__(
        self, regressions: Regressions, robot: Robot, held: Callable[[int], Iterable[Args]], full: Callable[[], None]
    ) -> None:
        """`held` returns the facts of a predicate that hold; `full` is called once if the graph is full."""
        super().__init__()
        self._regressions = regressions
        self._compare: Comparison = regressions.compare
        self._robot = robot
        self._home = self._compare.one(robot)
        self._held = held
        self._full = full
        self._is_full = False
        self._ground: dict[int, dict[Row, WantedFact]] = {}
        self._open: dict[int, dict[Row, WantedFact]] = {}
        self._tables: dict[int, SideFacts] = {}
        self._uses: dict[int, list[SideUse]] = {}
        """Places of each predicate's side atoms, of the predicates that are wanted."""
        self._wanted: set[int] = set()
        self._changes: deque[tuple[int, Args, bool]] = deque()
        self._roots: deque[tuple[int, Patterns, bool]] = deque()
        self._job: Iterator[None] | None = None

    # Input

    def goal(self, predicate: int, args: Patterns, wanted: bool) -> None:
        """Note that a goal has been opened, or discharged."""
        self.exact = -1
        self._roots.append((predicate, args, wanted))

    def changed(self, predicate: int, args: Args, holds: bool) -> bool:
        """Note that a fact has been inserted or removed; return False if too many changes wait for `work`."""
        if predicate not in self._tables:
            return True
        self.exact = -1
        self._changes.append((predicate, args, holds))
        return len(self._changes) <= CHANGES_MAX

    def work(self, budget: int) -> int:
        """Bring the levels up to date, for at most about `budget` steps; return what is left of it."""
        self._left = budget
        if self._job is None:
            if not (self._changes or self._roots or self._queue):
                self.exact = FAR
                return budget
            self._job = self._work()
        if next(self._job, self) is self:
            self._job = None
            self.exact = FAR
        return max(0, self._left)

    # Output

    def level(self, predicate: int, args: Args) -> int | None:
        """Return the level of a fact: FAR if no way leads from it, None if that is not known yet."""
        row = self._compare.row(args)
        lowest = FAR
        ground = self._ground.get(predicate)
        if ground is not None and (node := ground.get(row)) is not None and node.level == node.ahead:
            lowest = node.level
        for node in self._open.get(predicate, {}).values():
            if node.level < lowest and node.level == node.ahead and _agrees(node.args, row):
                lowest = node.level
        return lowest if lowest <= self.exact else None

    def way(self, predicate: int, args: Args) -> list[GroundStep]:
        """Return a shortest way from a fact to a goal; empty if it is one, there is none, or levels are not final."""
        level = self.level(predicate, args) if self.is_done else None
        row = self._compare.row(args)
        nodes = [*self._ground.get(predicate, {}).values(), *self._open.get(predicate, {}).values()]
        at = next((node for node in nodes if node.level == node.ahead == level and _agrees(node.args, row)), None)
        steps: list[GroundStep] = []
        while at is not None and at.level:
            steps.append(next(s for s in at.from_here if not s.blockers and s.end.level == at.level - 1))
            at = steps[-1].end
        return steps

    def shown(self, row: Row) -> tuple[Value | Pattern, ...]:
        """Return arguments of a node or side fact as values; slots and ANY where it is open."""
        return tuple([arg if isinstance(arg, Slot | Anything) else self._compare.value(arg) for arg in row])

    # The work

    def _work(self) -> Iterator[None]:
        """Apply all changes, then settle levels, nearest first; yield where the budget is used up."""
        while True:
            if self._roots:
                self.exact = -1
                self._root(*self._roots.popleft())
            elif self._changes:
                self.exact = -1
                yield from self._change(*self._changes.popleft())
            elif self._queue:
                yield from self._settle()
            else:
                return
            self._left -= 1
            if self._left <= 0:
                yield

    def _root(self, predicate: int, args: Patterns, wanted: bool) -> None:
        if predicate not in self._wanted:
            self._want(predicate)
        node = self._node(predicate, self._row(args))
        if node is not None:
            node.goals = int(wanted)
            self._look_ahead(node)

    def _want(self, predicate: int) -> None:
        """Note that facts of a predicate are wanted: which side atoms matter from now on."""
        self._wanted.add(predicate)
        for which, regression in enumerate(self._regressions.deriving.get(predicate, ())):
            for option, chain in enumerate(regression.options):
                for place, side in enumerate(chain.sides):
                    self._uses.setdefault(side.predicate, []).append(SideUse(which, regression, option, place))

    def _row(self, args: Patterns) -> Row:
        return tuple([self._compare.one(arg.value) if isinstance(arg, Constant) else arg for arg in args])

    def _node(self, predicate: int, args: Row) -> WantedFact | None:
        """Return the node of a wanted fact; None if there is none and no room for it."""
        is_open = any(isinstance(arg, Slot | Anything) for arg in args)
        nodes = (self._open if is_open else self._ground).setdefault(predicate, {})
        node = nodes.get(args)
        if node is None and self._has_room():
            node = nodes[args] = WantedFact(predicate, args)
            if predicate not in self._wanted:
                self._want(predicate)
        return node

    def _has_room(self) -> bool:
        if self._edges < EDGES_MAX:
            self._edges += 1
            return True
        if not self._is_full:
            self._is_full = True
            self._full()
        return False

    # Exploration

    def _expand(self, node: WantedFact) -> Iterator[None]:
        """Find the steps to a node that is reached for the first time."""
        for _, regression in self._fitting(node):
            env = self._bound(regression, node)
            if env is None:
                continue
            for option in regression.options:
                order = tuple(range(len(option.sides)))
                for found in self._join(option, env, [], order, 0):
                    if found is None:
                        yield
                    else:
                        self._step(regression, option, node, env, found)

    def _fitting(self, node: WantedFact) -> Iterable[tuple[int, Regression]]:
        """Return the regressions that may derive what a node wants, with their places."""
        regressions = self._regressions.deriving.get(node.predicate, [])
        if not any(isinstance(arg, Slot | Anything) for arg in node.args):
            return enumerate(regressions)
        if node.narrowed is None:
            wanted = tuple([self._pattern(arg) for arg in node.args])
            narrowed = [(which, self._regressions.narrowed(each, wanted)) for which, each in enumerate(regressions)]
            node.narrowed = [(which, each) for which, each in narrowed if each is not None]
        return node.narrowed

    def _pattern(self, arg: object) -> Pattern:
        return arg if isinstance(arg, Slot | Anything) else Constant(self._compare.value(arg))

    def _bound(self, regression: Regression, node: WantedFact) -> Env | None:
        """Return the slots that a wanted fact binds; None if the regression derives no such fact."""
        if regression.home is not None and regression.home.value != self._robot:
            return None
        env: Env = [None] * regression.slots
        env[SELF_SLOT] = self._home
        return env if self._agrees(regression.derives, node.args, env, []) else None

    def _agrees(self, terms: Terms, wanted: Row, env: Env, trail: list[int]) -> bool:
        """Match what is derived with what is wanted; open arguments were taken in by narrowing."""
        for place, value in terms.constants:
            if wanted[place] != value and not _is_open(wanted[place]):
                return False
        for place, slot in terms.slots:
            value = wanted[place]
            if _is_open(value):
                continue
            if env[slot] is None:
                env[slot] = value
                trail.append(slot)
            elif env[slot] != value:
                return False
        return True

    def _join(
        self, option: ChainOption, env: Env, picked: list[FactKey], order: tuple[int, ...], at: int
    ) -> Iterator[list[FactKey] | None]:
        """Yield the facts for each way to satisfy the side atoms, with values in `env`; None: the budget is used."""
        if at == len(order):
            yield picked
            return
        side = option.sides[order[at]]
        mask, key = probe(side.terms, env)
        table = self._tables.get(side.predicate)
        if table is None:
            table = self._tables[side.predicate] = SideFacts()
            table.rows(mask, key, side.terms.arity)  # makes the index, which is then filled within the budget
            yield from self._load(side.predicate, table)
        trail: list[int] = []
        for row in table.rows(mask, key, side.terms.arity):
            self._left -= 1
            if self._left <= 0:
                yield None
            if matches(side.terms, row, env, trail):
                picked.append((side.predicate, row))
                if at + 1 == len(order):
                    yield picked
                else:
                    yield from self._join(option, env, picked, order, at + 1)
                picked.pop()
            undo(env, trail)

    def _load(self, predicate: int, table: SideFacts) -> Iterator[None]:
        """Copy the facts of a predicate that hold."""
        for args in list(self._held(predicate)):
            table.add(self._compare.row(args))
            self._left -= 1
            if self._left <= 0:
                yield

    def _step(
        self, regression: Regression, option: ChainOption, end: WantedFact, env: Env, picked: list[FactKey]
    ) -> None:
        """Add the step of one joined instance, if its conditions hold."""
        trail: list[int] = []
        if all(self._holds(check, regression, env, trail) for check in regression.checks):
            start = self._node(option.predicate, _premise(option.terms, env))
            if start is not None and start is not end and self._has_room():
                step = GroundStep(regression.rule, start, end, tuple(picked))
                start.from_here[step] = end.to_here[step] = None
                for fact in step.facts:
                    self._steps_with.setdefault(fact, {})[step] = None
                for absent in regression.absents:
                    self._watch(step, absent, env)
                if not step.blockers and end.level < FAR:
                    self._lower(start, end.level + 1)
        undo(env, trail)

    def _holds(self, check: Check, regression: Regression, env: Env, trail: list[int]) -> bool:
        """Evaluate a condition whose variables all have values; any other is taken for granted."""
        values: list[Value] = [self._robot] * regression.slots
        for slot in check.loads:
            form = self._form(slot, regression, env)
            if form is None:
                return True
            values[slot] = self._compare.value(form)
        try:
            value = evaluate(check.code, values, 0)
        except NoValue:
            return False
        if check.target is None:
            return value is True
        form = self._compare.one(value)
        target = resolved(Slot(check.target), regression.known)
        if isinstance(target, Slot):
            if env[target.index] is None:
                env[target.index] = form
                trail.append(target.index)
            return bool(env[target.index] == form)
        return not isinstance(target, Constant) or self._compare.one(target.value) == form

    def _form(self, slot: int, regression: Regression, env: Env) -> object:
        """Return the form of a slot's value; None if it has none."""
        term: Pattern = resolved(Slot(slot), regression.known)
        if isinstance(term, Constant):
            return self._compare.one(term.value)
        return env[term.index] if isinstance(term, Slot) else None

    def _watch(self, step: GroundStep, absent: AbsentAtom, env: Env) -> None:
        """Register a step for the facts that a ``not`` forbids, and count those that hold."""
        if not is_known(absent, env):
            return  # the value of a variable is not known: taken for granted
        table = self._tables.get(absent.predicate)
        if table is None:
            table = self._tables[absent.predicate] = SideFacts()
            for args in self._held(absent.predicate):
                table.add(self._compare.row(args))
        mask, key = probe(absent.terms, env)
        watched = table.blocking.setdefault((mask, absent.twins), {})
        steps = watched.setdefault(key, {})
        if step in steps:
            return  # the rule has this ``not`` twice
        steps[step] = None
        step.absents.append((watched, key))
        rows = table.rows(mask, key, absent.terms.arity)
        step.blockers += sum(has_twins(row, absent.twins) for row in rows) if absent.twins else len(rows)

    # Changes of facts

    def _change(self, predicate: int, args: Args, holds: bool) -> Iterator[None]:
        """Apply the insertion or removal of a fact."""
        table = self._tables[predicate]
        row = self._compare.row(args)
        if not (table.add(row) if holds else table.remove(row)):
            return
        for (mask, twins), watched in table.blocking.items():
            if has_twins(row, twins):
                for step in watched.get(tuple([row[place] for place in mask]), ()):
                    self._block(step, 1 if holds else -1)  # type: ignore[arg-type]
                    self._left -= 1
                    if self._left <= 0:
                        yield
        if holds:
            for use in self._uses.get(predicate, ()):
                yield from self._extend(use, (predicate, row))
        else:
            for step in self._steps_with.pop((predicate, row), ()):
                self._cut(step, (predicate, row))
                self._left -= 1
                if self._left <= 0:
                    yield

    def _extend(self, use: SideUse, fact: FactKey) -> Iterator[None]:
        """Find the steps to nodes explored before that a new fact makes possible."""
        regression = use.regression
        env: Env = [None] * regression.slots
        env[SELF_SLOT] = self._home
        if regression.home is not None and regression.home.value != self._robot:
            return
        trail: list[int] = []
        if matches(regression.options[use.option].sides[use.place].terms, fact[1], env, trail):
            for node in self._derived_under(regression, env):
                mark = len(trail)
                if node.expanded and self._agrees(regression.derives, node.args, env, trail):
                    yield from self._joined(regression, use, node, env, fact)
                undo(env, trail, mark)
                self._left -= 1
                if self._left <= 0:
                    yield
        for node in list(self._open.get(regression.predicate, {}).values()):
            if node.expanded:
                yield from self._extend_open(use, node, fact)

    def _derived_under(self, regression: Regression, env: Env) -> list[WantedFact]:
        """Return the ground nodes that a regression may derive with the slots bound so far."""
        nodes = self._ground.get(regression.predicate)
        if not nodes:
            return []
        mask, key = probe(regression.derives, env)
        if len(mask) == regression.derives.arity:
            node = nodes.get(key)
            return [] if node is None else [node]
        return list(nodes.values())

    def _extend_open(self, use: SideUse, node: WantedFact, fact: FactKey) -> Iterator[None]:
        for which, regression in self._fitting(node):
            if which != use.which:
                continue
            env = self._bound(regression, node)
            # Narrowing may change the order of the side atoms: each place of the predicate is tried.
            option = regression.options[use.option]
            places = [place for place, side in enumerate(option.sides) if side.predicate == fact[0]]
            uses = regression_uses(use)
            if env is None or use.place != uses[0]:
                continue
            for place in places:
                trail: list[int] = []
                if matches(option.sides[place].terms, fact[1], env, trail):
                    narrowed = SideUse(which, regression, use.option, place)
                    yield from self._joined(regression, narrowed, node, env, fact)
                undo(env, trail)

    def _joined(
        self, regression: Regression, use: SideUse, node: WantedFact, env: Env, fact: FactKey
    ) -> Iterator[None]:
        """Add the steps to a node with a new fact in the place of one side atom."""
        option = regression.options[use.option]
        order = option.rests[use.place]
        before = [at for at, place in enumerate(order) if place < use.place]
        for found in self._join(option, env, [], order, 0):
            if found is None:
                yield
            # The fact in two places: such an instance is found once, from the first of them.
            elif not any(found[at] == fact for at in before):
                self._step(regression, option, node, env, [*found, fact])


def regression_uses(use: SideUse) -> list[int]:
    """Return the places of the side atoms with the predicate of `use`."""
    sides = use.regression.options[use.option].sides
    predicate = sides[use.place].predicate
    return [place for place, side in enumerate(sides) if side.predicate == predicate]


def _premise(terms: Terms, env: Env) -> Row:
    """Return what a rule wants as its premise, as far as it is known."""
    known: dict[int, object] = dict(terms.constants)
    unknown: dict[int, int] = {}
    for place, slot in terms.slots:
        if env[slot] is None:
            unknown[place] = slot
        else:
            known[place] = env[slot]
    if len(known) == terms.arity:
        return tuple([known[place] for place in range(terms.arity)])
    slots = [Slot(unknown[place]) if place in unknown else ANY for place in range(terms.arity) if place not in known]
    rest = iter(numbered(slots))
    return tuple([known[place] if place in known else next(rest) for place in range(terms.arity)])


def _is_open(arg: object) -> bool:
    return isinstance(arg, Slot | Anything)


def _agrees(wanted: Row, row: Row) -> bool:
    """Return whether a fact is what is wanted; the same variable is the same value."""
    values: dict[int, object] = {}
    for one, other in zip(wanted, row, strict=True):
        if isinstance(one, Slot):
            if values.setdefault(one.index, other) != other:
                return False
        elif one != other and not isinstance(one, Anything):
            return False
    return True
