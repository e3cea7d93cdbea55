"""Rules over several robots, rewritten as rules of one robot each (the protocol of docs/language.md, "Ensemble rules").

The robots exchange facts of predicates whose names the program does not use; the byte-code says of each what the
runtime does with it (`rmr.bytecode.program.Duty`). A life number is the number of a robot's earlier starts.

TOLD. The home subscribes once; the remote tells each match of its part once; the home joins the copies.

OFFERED. The home sets the facts of its own part aside under a number and offers to the remote, which it names with the
life that it knows. The remote fires or refuses at once:

    home                                   remote
    draw: p aside, note, offer     --->    offer of another life: refuse, tell the life
                                           part holds: consume it, decide    (the facts of its head wait)
    decided: facts aside go, head  <---    fired
                                   ack     the facts of its head come
    refused: facts aside return    <---    refused; the wish is kept
    wish granted: draw again       <---    have: the part holds now

A decision takes effect at the home before the remote acts on it: the remote's part of the head is derived when the home
has acknowledged. A remote that dies before that has shown nothing. Every message names the lives that it is about, so
that no offer is decided twice. A home that hears of the next life of a remote takes back what it has offered to the
earlier one, unless that one's decision has come: the exchange drops what comes from an earlier life of its sender.

RESERVED. With two or three remotes that decide, all but the last set their part aside first, in ascending order of the
robots' numbers, which makes a circle of waiting robots impossible. The home offers to the last one when all have
reserved, and tells them what was decided. The rules are written for each order of the robots that the conditions leave
possible, with a test of their numbers. `decision` says what each message carries, `decision_remote` what becomes of
reservations when robots die.

A remote that itself waits for a decision does not refuse an offer from a robot with a lower number: it answers when its
own facts are back. Of robots that offer to one another, one therefore fires.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import permutations

from rmr.bytecode.program import Best, Duty, Kind
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.lower.decision import Decision
from rmr.lang.lower.decision_home import HomeRules
from rmr.lang.lower.decision_remote import RemoteRules
from rmr.lang.lower.ensemble_writer import INT, ROBOT_TYPE, EnsembleWriter, RuleWriter
from rmr.lang.lower.joint_plan import (
    JointPlan,
    RemotePart,
    known_from,
    names_in,
)
from rmr.lang.read.syntax import (
    Binary,
    Call,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    Literal,
    RuleItem,
    Variable,
)


def rewritten(plan: JointPlan, writer: EnsembleWriter, found: Diagnostics) -> list[RuleItem]:
    """Return the rules of one robot that a plan becomes, those that answer others first."""
    writer.result.plans.append(plan)
    return _Rewriting(writer, plan, found).rules()


class _Rewriting(RuleWriter):
    """The rewriting of one rule."""

    def rules(self) -> list[RuleItem]:
        plan = self.plan
        self.learn([*plan.facts, *[fact for part in plan.remotes for fact in part.facts]])
        rules: list[RuleItem] = []
        facts: list[FactNode] = list(plan.facts)
        conditions: list[Condition] = list(plan.conditions)
        for part in plan.told:
            view, more, conditions = self._told(part, conditions)
            facts.append(view)
            rules += more
        parts = []
        for part in plan.offered:
            if part.inverted is None:
                parts.append(part)
                continue
            # The home learns from the remote's link that there is this robot.
            view, more, conditions = self._told(replace(part, facts=(part.inverted,), absent=()), conditions)
            facts.append(view)
            rules += more
            parts.append(replace(part, facts=tuple(each for each in part.facts if each is not part.inverted)))
        if parts:
            return [*rules, *self._offered(parts, facts, conditions)]
        body: tuple[Conjunct, ...] = (*facts, *conditions, *plan.folds, *plan.absent)
        return [*rules, RuleItem(body, plan.rule.head, self._span)]

    # ---- told

    def _told(self, part: RemotePart, conditions: list[Condition]) -> tuple[FactNode, list[RuleItem], list[Condition]]:
        """Return the home's copy of a remote part, the rules that make it, and the conditions left for the home."""
        home = self.home
        remote = part.owner
        ends = {each.name for each in (home, remote) if isinstance(each, Variable)}
        place = self._names.of(part.facts[0]).best
        changing: set[str] = set()
        if place is not None:
            # A better fact takes the place of what was told, so all of it is told, and tested by the home.
            fact, equations = self._whole(part.facts[0], ends)
            part = replace(part, facts=(fact,), inverted=fact if part.inverted is not None else None)
            conditions = [*conditions, *equations]
            changing = set(names_in(fact.arguments[1 + place.argument :]))
        own = known_from(part.facts, [])
        named = own - changing | ends
        pushed = [each for each in conditions if set(names_in(each)) <= named and set(names_in(each)) - ends]
        left = [each for each in conditions if each not in pushed]
        shown = [name for name in names_in(part.facts) if name not in ends and name in own]
        argument = (remote,) if isinstance(remote, Variable) else ()
        before = len(argument) + len(shown) - len(changing)
        best = None if place is None else Best(before, place.least)
        types = [*[ROBOT_TYPE for _ in argument], *[self.type(name) for name in shown]]
        view = self.make("told", Duty.VIEW, types, Kind.PERSISTENT, best=best)
        self.must_fit("what is told", shown, 3)
        copy = self.fact(view, home, *argument, *self.variables(shown))
        rules = []
        if part.inverted is not None:
            # The remote's own fact names the home: it needs no subscription. After a restart it tells all again.
            life = self.new(INT)
            again = self.shared("knows", remote, home, life)
            positive = self.test(">", life, Literal(0, self.at))
            rules.append(self.rule([*part.facts, *pushed], [copy]))
            rules.append(self.rule([*part.facts, *pushed, again, positive], [copy]))
            return copy, rules, left
        wish = self.make("wish", Duty.VIEW, [ROBOT_TYPE, INT], Kind.PERSISTENT)
        wished = self.make("wished", Duty.NOTE, [ROBOT_TYPE], Kind.PERSISTENT)
        life = self.new(INT)
        other = self.new(INT)
        mine = self.shared("life", home, life)
        sent = self.fact(wish, remote, home, life)
        if part.link is not None and all(isinstance(each, Literal | Variable) for each in part.link.arguments):
            link: list[Conjunct] = [*self.kept([part.link])]
        else:
            link = [*self.kept(self.plan.facts), *self._needed(part)]
        rules.append(
            self.rule(
                [*link, mine, self.fact(wished, home, remote, absent=True)], [self.fact(wished, home, remote), sent]
            )
        )
        told_of = [self.fact(wished, home, remote), mine, self.shared("knows", home, remote, other)]
        rules.append(self.rule([*told_of, self.test(">", other, Literal(0, self.at))], [sent]))
        asked = self.fact(wish, remote, home, self.variable("_"))
        rules.append(self.rule([asked, *part.facts, *pushed], [copy]))
        return copy, rules, left

    def _needed(self, part: RemotePart) -> list[Condition]:
        """Return the equations that compute the robot of a remote part."""
        if isinstance(part.owner, Literal):
            return []
        known = known_from(self.plan.facts, [])
        needed: list[Condition] = []
        bound = known_from(self.plan.facts, self.plan.conditions)
        for each in self.plan.conditions:
            is_equation = isinstance(each.expression, Binary) and each.expression.operator == "="
            if is_equation and set(names_in(each)) <= bound:
                needed.append(each)
        return [] if part.owner.name in known else needed

    def _whole(self, fact: FactNode, ends: Collection[str]) -> tuple[FactNode, list[Condition]]:
        """Return a `min` or `max` atom that any fact matches, but for the key's constants, and tests of what it has."""
        best = self._names.of(fact).best
        assert best is not None
        arguments: list[Expression] = [fact.arguments[0]]
        tests = list[Condition]()
        for place, kind in enumerate(self.writer.types.arguments(fact.name.text)):
            each = fact.arguments[1 + place]
            named = isinstance(each, Variable) and not each.anonymous
            end = isinstance(each, Variable) and each.name in ends
            fixed = end or isinstance(each, Literal)
            new = named and not end and not {*names_in(each)} & {*names_in(arguments)}
            if new or (fixed and place < best.argument):
                arguments.append(each)
            else:
                variable = self.new(kind)
                arguments.append(variable)
                if named or not isinstance(each, Variable):
                    tests.append(self.test("=", variable, each))
        return replace(fact, arguments=tuple(arguments)), tests

    # ---- offered

    def _offered(self, parts: list[RemotePart], facts: list[FactNode], conditions: list[Condition]) -> list[RuleItem]:
        """Return the rules for remotes that decide, in each order that their numbers may have."""
        facts, equations = self._plainly(facts)
        conditions = [*equations, *conditions]
        results = [fold.result.name for fold in self.plan.folds if fold.result is not None]
        known = known_from(facts, conditions, results)
        here = [each for each in conditions if set(names_in(each)) <= known]
        there = [each for each in conditions if each not in here]
        rules: list[RuleItem] = []
        for order in permutations(parts):
            if _is_excluded(order, here):
                continue
            *reserving, last = order
            bookings = []
            left = there
            for part in reserving:
                plain, more = self._plainly(part.facts)
                bookings.append(replace(part, facts=tuple(plain)))
                left = [*more, *left]
            rules += _decided(Decision(self, [*bookings, last], facts, here, left, known))
        return rules

    def _plainly(self, facts: Iterable[FactNode]) -> tuple[list[FactNode], list[Condition]]:
        """Return the home's atoms with variables and constants only, so that what is consumed can come back."""
        plain: list[FactNode] = []
        equations: list[Condition] = []
        for fact in facts:
            arguments: list[Expression] = [fact.arguments[0]]
            cells = self._types.positions[fact.name.text][1:]
            for argument, cell in zip(fact.arguments[1:], cells, strict=True):
                open_ended = isinstance(argument, Variable) and argument.anonymous
                named = isinstance(argument, Literal | Variable) and not open_ended
                if named or (open_ended and not self.consumable(fact)):
                    arguments.append(argument)
                else:
                    variable = self.new(cell.type)
                    arguments.append(variable)
                    if not open_ended:
                        equations.append(self.test("=", variable, argument))
            plain.append(replace(fact, arguments=tuple(arguments)))
        return plain, equations


def _decided(decision: Decision) -> list[RuleItem]:
    """Return the rules of a rule that is decided, those that answer another robot first."""
    home = HomeRules(decision)
    return [
        *RemoteRules(decision).answers(),
        *home.outcomes(),
        *[home.greet(step) for step in decision.steps],
        home.draw(),
    ]


def _is_excluded(order: Sequence[RemotePart], here: Sequence[Condition]) -> bool:
    """Whether the home's conditions compare the numbers of robots in another order."""
    names = [each.owner.name if isinstance(each.owner, Variable) else None for each in order]
    for condition in here:
        test = condition.expression
        if not isinstance(test, Binary) or test.operator not in {"<", "<=", ">", ">="}:
            continue
        smaller, larger = (_numbered(each) for each in (test.left, test.right))
        if test.operator in {">", ">="}:
            smaller, larger = larger, smaller
        both = smaller in names and larger in names and None not in {smaller, larger}
        if both and names.index(smaller) > names.index(larger):
            return True
    return False


def _numbered(expression: Expression) -> str | None:
    """Return the name of the variable whose robot's number an expression is."""
    if isinstance(expression, Call) and expression.name.text == "id":
        robot = expression.arguments[0]
        return robot.name if isinstance(robot, Variable) else None
    return None
