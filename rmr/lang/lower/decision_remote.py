"""The rules of the robots that a home asks: reserve, decide, and find out what was decided when the home has died.

A reserving robot hears of the home's next life and asks the last one. If that one knows of a decision, it tells all
that have reserved, by itself, for it hears of that life, too. Without a decision it answers that there is none, as
soon as no offer of the dead life can reach it any more. If the last one has died as well, its next life cannot know:
of two reserving robots each then asks the other, which may have learned of the decision from the home. One that is in
the same doubt answers that it knows of none: neither can learn of one any more, for what comes from an earlier life of
its sender is dropped.
"""

from collections.abc import Sequence

from rmr.lang.lower.decision import Decision, DecisionStep, Owner, absent, kept
from rmr.lang.read.syntax import Binary, Conjunct, Expression, FactNode, HeadItem, Literal, RuleItem, Variable


class RemoteRules:
    """The rules of the robots that are asked."""

    def __init__(self, decision: Decision) -> None:
        self._d = decision
        self._w = decision.w
        self._home = decision.home

    def answers(self) -> list[RuleItem]:
        """Return the rules that answer the home, and those that end a transaction."""
        rules: list[RuleItem] = []
        for step in self._d.reserving:
            rules += self._reserves(step)
        rules += self._decides()
        if self._d.reserving:
            rules += self._leftovers()
            rules += self._telling()
            rules += self._says_what_was()
        return rules

    # ---- answers

    def _answer(
        self,
        step: DecisionStep,
        question: FactNode,
        numbers: Sequence[Variable],
        positive: Sequence[FactNode],
        yes: list[HeadItem],
    ) -> list[RuleItem]:
        """Return the rules that answer a question: yes, no with a wish, no from another life, and the wish granted."""
        d = self._d
        w = self._w
        home = self._home
        me = step.owner
        life, number, mine, real = numbers
        keys = w.variables(step.keys)
        here = w.shared("life", me, mine)
        tests: list[Conjunct] = [*step.tests, *step.part.absent]
        whole: list[Conjunct] = [*w.kept(step.part.facts), *tests]
        refusal = w.fact(step.refused, home, life, number)
        wish = w.fact(step.want, me, home, *keys)
        # The robot's own offers are out: its facts may come back, and it waits for that before it refuses a robot with
        # a lower number. Waiting leads from lower to higher numbers only, so it ends.
        busy = d.none(w.shared("out", me, w.variable("_")), w.test("<", d.id(home), d.id(me)))
        elsewhere = w.test("!=", mine, real)
        news = w.shared("knows", home, me, real)
        granted = w.fact(step.have, home, me, mine, *w.variables(step.home_keys))
        closed = self._closed(step, life)
        # A robot that has waited and may ask again has a turn. Others are refused until it asks, `TURN` times at most.
        other = d.robot()
        (left,) = d.numbers(1)
        turn = w.shared("turn", me, home, w.variable("_"))
        another = w.shared("turn", me, other, left)
        passed = w.shared("turn", me, other, Binary("-", left, Literal(1, w.at), w.at))
        spent = w.test("<", left, Literal(2, w.at))
        blocked: list[Conjunct] = [question, here, another, absent(turn)]
        ask_again: list[HeadItem] = [refusal, granted, *closed]
        return [
            w.rule([question, here, turn, *positive, *tests], [*yes, *closed]),
            w.rule(
                [question, here, absent(w.shared("turn", me, w.variable("_"), w.variable("_"))), *positive, *tests],
                [*yes, *closed],
            ),
            w.rule([*blocked, spent], ask_again),
            w.rule([*blocked, w.test(">", left, Literal(1, w.at))], [*ask_again, passed]),
            w.rule([question, here, d.none(*whole), busy], [refusal, wish, *closed]),
            w.rule([question, w.shared("life", me, real), elsewhere], [refusal, news]),
            w.rule([wish, here, *whole], [granted, w.shared("turn", me, home, Literal(TURN, w.at))]),
        ]

    def _closed(self, step: DecisionStep, life: Expression) -> list[HeadItem]:
        """Return what an offer says of an earlier transaction: all know its decision."""
        d = self._d
        if step is not d.last or not d.reserving:
            return []
        return [d.about(d.forget, step.owner, life, self._w.variable(CLOSED))]

    def _reserves(self, step: DecisionStep) -> list[RuleItem]:
        """Return the rules of a robot that reserves."""
        d = self._d
        w = self._w
        home = self._home
        me = step.owner
        life, number, mine, real = d.numbers(4)
        others: list[Expression] = []
        for each in d.steps:
            if each is not step:
                others += [each.owner, *d.numbers(1)]
        question = d.about(step.question, me, life, number, mine, *others, *w.variables(step.keys))
        booked = d.about(step.record, me, life, number, *others, *w.variables(step.held))
        facts = d.set_aside(step)
        aside = d.aside(facts, me, number)
        answer = w.fact(step.answer, home, life, number, *w.variables(step.gives))
        commit = d.about(d.commit, me, life, number, *w.variables(d.carried))
        abort = d.about(d.abort, me, life, number)
        did = [self._did(step, life, number)] if step.did else []
        rules = [
            *self._answer(step, question, (life, number, mine, real), step.taken, [booked, *aside, answer]),
            w.rule([commit, booked, *aside], [*d.returned(facts, kept=True), *did, *step.theirs]),
            w.rule([abort, booked, *aside], d.returned(facts)),
        ]
        lives = dict(zip([each.place for each in d.steps if each is not step], others[1::2], strict=True))
        return [*rules, *self._asks(step, booked, life, number, lives)]

    def _decides(self) -> list[RuleItem]:
        """Return the rules of the robot that decides."""
        d = self._d
        w = self._w
        home = self._home
        last = d.last
        me = last.owner
        life, number, mine, real = d.numbers(4)
        closed = [w.variable(CLOSED)] if d.reserving else []
        sent = (*closed, *w.variables(last.keys), *w.variables(last.extras))
        offer = d.about(last.question, me, life, number, mine, *sent)
        answer = w.fact(last.answer, home, life, number, *w.variables(last.gives))
        held = d.about(last.record, me, life, number, *w.variables(last.held)) if last.record else None
        noted = [*([held] if held else []), *([self._did(last, life, number)] if last.did else [])]
        rules = self._answer(last, offer, (life, number, mine, real), last.part.facts, [*noted, answer])
        if held is not None:
            stands = d.about(d.stands, me, life, number, *d.anything(last.gives))
            rules.append(w.rule([stands, held], last.theirs))
            # An offer to itself: no radio, no acknowledgement.
            rules.append(w.rule([held, w.test("=", home, me)], last.theirs))
        return rules

    # ---- the end of a transaction

    def _did(self, step: DecisionStep, life: Expression, number: Expression) -> FactNode:
        d = self._d
        return d.about(step.did, step.owner, life, number, *self._others(step), *self._w.variables(d.carried))

    def _others(self, step: DecisionStep) -> list[Owner]:
        """Return the reserving robots but the one of a step."""
        return [each.owner for each in self._d.reserving if each is not step]

    def _any_did(self, step: DecisionStep, me: Owner, life: Expression, number: Expression) -> FactNode:
        d = self._d
        return d.about(step.did, me, life, number, *d.anything(self._others(step)), *d.anything(d.carried))

    def _any_telling(self, step: DecisionStep, me: Owner, life: Expression, number: Expression) -> FactNode:
        d = self._d
        return d.about(step.telling, me, life, number, *d.anything(self._others(step)))

    def _knows_nothing(self, me: Owner, life: Expression, number: Expression) -> list[Conjunct]:
        """Return the conditions that a robot knows of no decision."""
        of_steps = [
            (self._any_did(each, me, life, number), self._any_telling(each, me, life, number))
            for each in self._d.holders
        ]
        return [absent(fact) for pair in of_steps for fact in pair]

    def _leftovers(self) -> list[RuleItem]:
        """Return the rules that drop what is about a transaction that has ended."""
        d = self._d
        w = self._w
        me = d.robot()
        life, number = d.numbers(2)
        nothing = d.no_booking(me, life, number)
        since = w.variable("_")
        over = [
            d.about(d.commit, me, life, number, *d.anything(d.carried)),
            d.about(d.abort, me, life, number),
            d.about(d.asking, me, life, number, since),
        ]
        if d.doubt:
            over += [d.about(d.doubt, me, life, number, since), d.about(d.lost, me, life, number)]
        rules = [w.rule([each, *nothing], []) for each in over]
        forget = d.about(d.forget, me, life, number)
        rules += [w.rule([forget, self._any_did(each, me, life, number)], []) for each in d.holders]
        none = [absent(self._any_did(each, me, life, number)) for each in d.holders]
        return [*rules, w.rule([forget, *none, d.pending(me, life, number)], [])]

    def _telling(self) -> list[RuleItem]:
        """Return the rules by which a robot that knows of a decision tells the reserving ones, if the home has died."""
        d = self._d
        w = self._w
        rules = []
        for step in d.holders:
            me = step.owner
            others = self._others(step)
            life, number = d.numbers(2)
            telling = d.about(step.telling, me, life, number, *others)
            commits = [d.about(d.commit, each, life, number, *w.variables(d.carried)) for each in others]
            known = [d.about(d.settled, me, life, number, *d.anything(d.carried)) for _ in others]
            settled = [
                FactNode(each.name, (me, other, *each.arguments[1:]), each.span)
                for each, other in zip(known, others, strict=True)
            ]
            rules.append(w.rule([self._did(step, life, number), *d.heard(me, life)], [telling, *commits]))
            rules.append(w.rule([telling, *settled], []))
        return rules

    # ---- after the death of the home

    def _asks(
        self, step: DecisionStep, booked: FactNode, life: Variable, number: Variable, lives: dict[int, Expression]
    ) -> list[RuleItem]:
        """Return the rules by which a reserving robot asks the last one, and then the other that has reserved."""
        d = self._d
        w = self._w
        me = step.owner
        last = d.last.owner
        about = d.about(d.ask, last, life, number, lives[d.last.place])
        ask = FactNode(about.name, (last, me, *about.arguments[1:]), about.span)
        held: list[Conjunct] = [kept(booked)]
        rules = self._again(held, d.asking, me, last, ask, life, number, d.heard(me, life))
        for other in self._others(step):
            about = d.about(d.query, other, life, number)
            query = FactNode(about.name, (other, me, *about.arguments[1:]), about.span)
            lost = d.about(d.lost, me, life, number)
            rules += self._again(held, d.doubt, me, other, query, life, number, [lost])
            doubt = d.about(d.doubt, me, life, number, w.variable("_"))
            rules.append(w.rule([lost, kept(doubt)], []))
        return rules

    def _again(
        self,
        held: list[Conjunct],
        note: str,
        me: Owner,
        other: Owner,
        message: FactNode,
        life: Variable,
        number: Variable,
        first: list[Conjunct],
    ) -> list[RuleItem]:
        """Return the rules that send a question when `first` holds, and again to each later life of the asked robot."""
        d = self._d
        w = self._w
        then, since = d.numbers(2)
        open_yet: list[Conjunct] = [d.pending(me, life, number), absent(d.about(d.abort, me, life, number))]
        none = absent(d.about(note, me, life, number, w.variable("_")))
        never = d.about(note, me, life, number, Literal(-1, w.at))
        noted = d.about(note, me, life, number, since)
        newer: list[Conjunct] = [noted, w.shared("knows", me, other, then), w.test("<", since, then)]
        return [
            w.rule([*held, *first, *open_yet, none], [never, message]),
            w.rule([*held, *newer, *open_yet], [d.about(note, me, life, number, then), message]),
        ]

    def _says_what_was(self) -> list[RuleItem]:
        """Return the rules that answer those who have reserved for a home that has died."""
        d = self._d
        w = self._w
        last = d.last
        me = last.owner
        asker = d.robot()
        life, number, mine, real = d.numbers(4)
        about = d.about(d.ask, me, life, number, mine)
        ask = FactNode(about.name, (me, asker, *about.arguments[1:]), about.span)
        abort = d.about(d.abort, asker, life, number)
        places: list[object] = [0, 0, *last.keys, *last.extras]
        no_offer = absent(d.about(last.question, me, life, number, *d.anything(places)))
        nothing: list[Conjunct] = [ask, *self._knows_nothing(me, life, number), no_offer]
        # No offer of the dead life can come any more, or none that names this life.
        heard: list[Conjunct] = [w.shared("life", me, mine), *d.heard(me, life)]
        another: list[Conjunct] = [w.shared("life", me, real), w.test("<", mine, real)]
        unknown = d.about(d.lost, asker, life, number) if d.lost else abort
        rules = [w.rule([*nothing, *heard], [abort]), w.rule([*nothing, *another], [unknown])]
        rules += self._known(last, ask, life, number)
        for step in d.reserving if d.query else []:
            rules += self._says_what_it_knows(step)
        return rules

    def _known(self, step: DecisionStep, question: FactNode, life: Variable, number: Variable) -> list[RuleItem]:
        """Return the rules that leave a question to the decision, which is told by itself."""
        me = step.owner
        facts = (self._any_did(step, me, life, number), self._any_telling(step, me, life, number))
        return [self._w.rule([question, kept(each)], []) for each in facts]

    def _says_what_it_knows(self, step: DecisionStep) -> list[RuleItem]:
        """Return the rules that answer the other robot that has reserved."""
        d = self._d
        w = self._w
        me = step.owner
        asker = d.robot()
        life, number = d.numbers(2)
        about = d.about(d.query, me, life, number)
        query = FactNode(about.name, (me, asker, *about.arguments[1:]), about.span)
        abort = d.about(d.abort, asker, life, number)
        others = [0 for _ in d.steps[1:] for _ in range(2)]
        booked = kept(d.about(step.record, me, life, number, *d.anything(others), *d.anything(step.held)))
        doubt = kept(d.about(d.doubt, me, life, number, w.variable("_")))
        none: list[Conjunct] = [*d.no_booking(me, life, number), *self._knows_nothing(me, life, number)]
        return [
            w.rule([query, booked, doubt, d.pending(me, life, number)], [abort]),
            w.rule([query, *none, *d.heard(me, life)], [abort]),
            *self._known(step, query, life, number),
        ]


TURN = 3
"""Questions of other robots that one turn refuses: it takes a round trip to ask again, and two to reserve and offer."""
CLOSED = "_closed'"
"""The variable of an offer for the number of an earlier transaction that is closed; -1 for none."""
