"""The rules of a home that asks others to decide: draw, ask one after the other, and what becomes of it.

The rule that draws is the ensemble rule as its home sees it: it takes part in the selection and sets the home's facts
aside. The home goes on to the next robot when one has reserved. The word of the last one decides, and the home tells
those that have reserved. Every other end returns the facts.
"""

from collections.abc import Iterable
from itertools import pairwise

from rmr.lang.lower.decision import Decision, DecisionStep, absent, taken
from rmr.lang.lower.decision_remote import CLOSED
from rmr.lang.lower.ensemble_writer import INT
from rmr.lang.read.syntax import Binary, Conjunct, Expression, FactNode, HeadItem, Literal, RuleItem


class HomeRules:
    """The rules of the home."""

    def __init__(self, decision: Decision) -> None:
        self._d = decision
        self._w = decision.w
        self._home = decision.home
        self._life, self._number = decision.numbers(2)
        self._lives = [self._w.new(INT) for _ in decision.steps]
        """The lives of the robots that are asked."""

    def outcomes(self) -> list[RuleItem]:
        """Return the rules for answers, and for answers that do not come."""
        d = self._d
        return [
            *[rule for step in d.reserving for rule in self._passed(step)],
            self._fired(),
            *[self._refused(step) for step in d.steps],
            *[rule for step in d.steps for rule in self._granted(step)],
            *[self._ended(step) for step in d.steps],
            *[self._second_refusal(step) for step in d.steps],
            *[self._late(each) for step in d.steps for each in self._answers(step)],
            *(self._closing() if d.reserving else ()),
        ]

    # ---- pieces

    def _robots(self) -> list[Expression]:
        """Return each robot that is asked with its life."""
        return [each for step in self._d.steps for each in (step.owner, self._lives[step.place])]

    def _note(self, step: DecisionStep) -> FactNode:
        w = self._w
        given = [name for each in self._d.steps[: step.place] for name in each.gives]
        return w.fact(
            step.note, self._home, self._number, *self._robots(), *w.variables(self._d.noted), *w.variables(given)
        )

    def _any_note(self, step: DecisionStep) -> FactNode:
        d = self._d
        places = [*self._robots(), *d.noted, *[name for each in d.steps[: step.place] for name in each.gives]]
        return absent(self._w.fact(step.note, self._home, self._number, *d.anything(places)))

    def _waiting(self, step: DecisionStep) -> list[Conjunct]:
        """Return the atoms that hold while the home waits for an answer; a firing of them ends the wait."""
        d = self._d
        w = self._w
        home = self._home
        aside = d.aside(d.consumed, home, self._number)
        return [w.shared("life", home, self._life), self._note(step), *aside, w.shared("out", home, self._number)]

    def _may(self, step: DecisionStep) -> FactNode:
        """Return the fact that lets the home ask a robot again."""
        w = self._w
        return w.fact(step.have, self._home, step.owner, self._lives[step.place], *w.variables(step.home_keys))

    def _asked(self, step: DecisionStep) -> FactNode:
        w = self._w
        return w.fact(step.asked, self._home, step.owner, self._lives[step.place], *w.variables(step.home_keys))

    def _yes(self, step: DecisionStep, *, any_values: bool = False) -> FactNode:
        w = self._w
        values = self._d.anything(step.gives) if any_values else w.variables(step.gives)
        return w.fact(step.answer, self._home, self._life, self._number, *values)

    def _no(self, step: DecisionStep) -> FactNode:
        return self._w.fact(step.refused, self._home, self._life, self._number)

    def _answers(self, step: DecisionStep) -> list[FactNode]:
        return [self._yes(step), self._no(step)]

    def _question(self, step: DecisionStep, *closed: Expression) -> FactNode:
        d = self._d
        w = self._w
        others: list[Expression] = []
        if step is not d.last:
            others = [
                each for other in d.steps if other is not step for each in (other.owner, self._lives[other.place])
            ]
        values = (*w.variables(step.keys), *w.variables(step.extras))
        mine = self._lives[step.place]
        return d.about(step.question, step.owner, self._life, self._number, mine, *others, *closed, *values)

    def _takes_back(self, step: DecisionStep) -> list[HeadItem]:
        """Return the end of an attempt at a step: who has reserved gives back, the others may be asked again."""
        d = self._d
        may = [self._may(each) for each in d.steps if each is not step]
        aborts = [d.about(d.abort, each.owner, self._life, self._number) for each in d.steps[: step.place]]
        return [*may, *aborts, *d.returned(d.consumed)]

    # ---- answers

    def _passed(self, step: DecisionStep) -> list[RuleItem]:
        """Return the rules that go on to the next robot when one has reserved.

        An offer names one earlier transaction with that robot of which all know the decision, so that no frame is
        needed for it; -1 if there is none.
        """
        d = self._d
        w = self._w
        home = self._home
        following = d.steps[step.place + 1]
        body: list[Conjunct] = [self._yes(step), w.shared("life", home, self._life), self._note(step)]
        note = self._note(following)
        if following is not d.last:
            return [w.rule(body, [note, self._question(following)])]
        earlier = w.variable(CLOSED)
        closed = w.fact(d.closed, home, following.owner, earlier)
        none = absent(w.fact(d.closed, home, following.owner, w.variable("_")))
        never = Literal(-1, w.at)
        return [
            w.rule([*body, closed], [note, self._question(following, earlier)]),
            w.rule([*body, none], [note, self._question(following, never)]),
        ]

    def _fired(self) -> RuleItem:
        d = self._d
        last = d.last
        body = [self._yes(last), *self._waiting(last)]
        may = [self._may(each) for each in d.steps]
        commits = [
            d.about(d.commit, each.owner, self._life, self._number, *self._w.variables(d.carried))
            for each in d.reserving
        ]
        closing = [self._closing_note()] if d.reserving else []
        head = [*may, *closing, *commits, *d.returned(d.consumed, kept=True), *d.ours]
        return self._w.rule(body, head)

    def _refused(self, step: DecisionStep) -> RuleItem:
        return self._w.rule([self._no(step), *self._waiting(step)], self._takes_back(step))

    def _granted(self, step: DecisionStep) -> list[RuleItem]:
        granted = self._may(step)
        asked = self._asked(step)
        return [self._w.rule([granted, asked], []), self._w.rule([granted, absent(asked)], [])]

    def _ended(self, step: DecisionStep) -> RuleItem:
        """Return the rule for a life that was asked and has ended: nothing of it arrives any more."""
        w = self._w
        (following,) = self._d.numbers(1)
        ended = w.test("<", self._lives[step.place], following)
        body = [
            *self._waiting(step),
            w.shared("knows", self._home, step.owner, following),
            ended,
            absent(self._yes(step, any_values=True)),
        ]
        return w.rule(body, self._takes_back(step))

    def _second_refusal(self, step: DecisionStep) -> RuleItem:
        """Return the rule for a question that reached two lives of a robot."""
        w = self._w
        return w.rule([self._no(step), w.shared("life", self._home, self._life), self._any_note(step)], [])

    def _late(self, answer: FactNode) -> RuleItem:
        """Return the rule for an answer that is about an earlier life of the home."""
        w = self._w
        (real,) = self._d.numbers(1)
        return w.rule([answer, w.shared("life", self._home, real), w.test("!=", self._life, real)], [])

    # ---- when all know the decision

    def _closing_note(self) -> FactNode:
        d = self._d
        return self._w.fact(d.closing, self._home, self._number, *[each.owner for each in d.steps])

    def _closing(self) -> list[RuleItem]:
        """Return the rules that end a transaction when those that have reserved have acknowledged the decision.

        The home itself may be one of them: then there is nothing to acknowledge.
        """
        d = self._d
        w = self._w
        home = self._home
        settled = [
            w.fact(d.settled, home, each.owner, home, self._life, self._number, *d.anything(d.carried))
            for each in d.reserving
        ]
        forget = [d.about(d.forget, each.owner, self._life, self._number) for each in d.holders if each is not d.last]
        head = [w.fact(d.closed, home, d.last.owner, self._number), *forget]
        body = [self._closing_note(), w.shared("life", home, self._life)]
        rules = [w.rule([*body, *settled], head)]
        for step in d.reserving:
            others = [each for each in settled if each is not settled[step.place]]
            rules.append(w.rule([*body, w.test("=", home, step.owner), *others], head))
        return rules

    # ---- the draw

    def _own_part(self, facts: Iterable[FactNode]) -> list[Conjunct]:
        d = self._d
        w = self._w
        plan = w.plan
        order = [w.test("<", d.id(one.owner), d.id(other.owner)) for one, other in pairwise(d.steps)]
        return [*facts, *d.here, *order, *plan.folds, *plan.absent]

    def greet(self, step: DecisionStep) -> RuleItem:
        """Return the rule that asks a robot which life it is in, once, before the first question."""
        w = self._w
        home = self._home
        fresh = w.shared("knows", home, step.owner, w.variable("_"), absent=True)
        once = w.shared("greeted", home, step.owner, absent=True)
        head = [w.shared("greeted", home, step.owner), w.shared("hello", step.owner, home)]
        return w.rule([*self._own_part(w.kept(self._d.facts)), fresh, once], head)

    def draw(self) -> RuleItem:
        """Return the rule that sets the home's facts aside and asks the first robot."""
        d = self._d
        w = self._w
        home = self._home
        first = d.steps[0]
        body = [
            *self._own_part(taken(d.facts)),
            *[w.shared("knows", home, step.owner, self._lives[step.place]) for step in d.steps],
            w.shared("life", home, self._life),
            w.shared("count", home, self._number),
            *[absent(self._asked(step)) for step in d.steps],
        ]
        head: list[HeadItem] = [
            w.shared("count", home, Binary("+", self._number, Literal(1, w.at), w.at)),
            w.shared("out", home, self._number),
            *d.aside(d.consumed, home, self._number),
            self._note(first),
            *[self._asked(step) for step in d.steps],
            self._question(first),
        ]
        return w.rule(body, head)
