"""The rules for two remote robots that decide: one reserves its part, the other decides.

The home sets its own facts aside. The remote with the lower number reserves: it sets its part aside as well. Then the
home offers to the other one, which decides as in `offer_rules`. The home tells the first one, which commits or takes
its facts back. The rules are written once for each order of the two, with a test of their numbers.

A home that dies leaves a reservation behind. The reserved robot hears of its next life and asks the one that decides.
That one has noted its decision until the home has reported that all know it; without a note it answers that nothing was
decided, as soon as no offer of the dead life can reach it any more.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from rmr.bytecode.program import Duty, Type
from rmr.lang.lower.ensemble_writer import INT, ROBOT_TYPE, RuleWriter
from rmr.lang.lower.joint_plan import RemotePart, called, head_at, known_from, names_in
from rmr.lang.read.syntax import (
    Binary,
    Call,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    HeadItem,
    Literal,
    Mark,
    Name,
    RuleItem,
    Variable,
)


class ReserveRules:
    """The rules for two remotes that decide, `first` with the lower number."""

    def __init__(
        self,
        writer: RuleWriter,
        first: RemotePart,
        last: RemotePart,
        facts: list[FactNode],
        here: list[Condition],
        there: list[Condition],
        known: set[str],
    ) -> None:
        """`first` has plain atoms (`RuleWriter.plainly`); `there` are the conditions that the home cannot test."""
        self._w = writer
        self._first = first
        self._last = last
        self._facts = facts
        self._here = here
        plan = writer.plan
        self._home: Variable | Literal = plan.home
        home, one, two = (_name(each) for each in (plan.home, first.owner, last.owner))
        head = plan.rule.head
        self._theirs_first: list[HeadItem] = [item for item in head if head_at(item, first.owner)]
        self._theirs_last: list[HeadItem] = [item for item in head if head_at(item, last.owner)]
        self._ours = [item for item in head if item not in self._theirs_first and item not in self._theirs_last]
        at_first = known_from(first.facts, there, known)
        self._with_first = [each for each in there if set(names_in(each)) <= at_first]
        self._with_last = [each for each in there if each not in self._with_first]
        used = list(names_in((first.facts, first.absent, tuple(self._with_first))))
        self._keys_first = [name for name in used if name in known and name not in {home, one}]
        """Values that decide whether the first part matches."""
        at_first = known_from(first.facts, self._with_first, {*self._keys_first, home, one})
        later = (last.facts, last.absent, tuple(self._with_last), tuple(self._ours), tuple(self._theirs_last))
        self._gives_first = [name for name in names_in(later) if name in at_first - known]
        mine = list(names_in(tuple(self._theirs_first)))
        self._carried = [name for name in mine if name not in at_first]
        """Values that the first robot's part of the head gets with the decision."""
        self._set_first = [fact for fact in first.facts if writer.consumable(fact)]
        wanted = [*names_in(tuple(self._set_first)), *mine]
        self._booked_values = [n for n in dict.fromkeys(wanted) if n in at_first and n not in {home, one}]
        both = known | set(self._gives_first)
        used = list(names_in((last.facts, last.absent, tuple(self._with_last))))
        self._keys_last = [name for name in used if name in both and name not in {home, two}]
        self._home_keys = [name for name in self._keys_last if name in known]
        at_last = known_from(last.facts, self._with_last, both) - both
        for_last = [*names_in(tuple(self._theirs_last)), *self._carried]
        self._extras = [
            n for n in dict.fromkeys(for_last) if n in both and n not in {home, two} and n not in self._keys_last
        ]
        self._gives_last = [n for n in dict.fromkeys([*names_in(tuple(self._ours)), *self._carried]) if n in at_last]
        self._held = [n for n in names_in(tuple(self._theirs_last)) if n in both | at_last and n not in {home, two}]
        self._set_home = [fact for fact in facts if writer.consumable(fact)]
        needed = [*names_in((tuple(self._set_home), tuple(self._ours)))]
        needed += [*self._carried, *self._keys_first, *self._keys_last, *self._extras]
        self._noted = [n for n in dict.fromkeys(needed) if n in known and n not in {home, one, two}]
        self._make()

    def _make(self) -> None:
        w = self._w
        robot = ROBOT_TYPE
        number = INT

        def types(names: Iterable[str]) -> list[Type]:
            return [w.type(name) for name in names]

        keys_one = types(self._keys_first)
        keys_two = types(self._keys_last)
        self._reserve = w.make("reserve", Duty.MESSAGE, [robot, number, number, number, robot, number, *keys_one])
        self._booked = w.make("booked", Duty.NOTE, [robot, number, number, robot, number, *types(self._booked_values)])
        self._reserved = w.make("reserved", Duty.MESSAGE, [number, number, *types(self._gives_first)])
        self._refused_first = w.make("refused", Duty.MESSAGE, [number, number])
        self._refused_last = w.make("refused", Duty.MESSAGE, [number, number])
        note = [number, robot, number, robot, number, *types(self._noted)]
        self._note = w.make("note", Duty.NOTE, note)
        self._note_offered = w.make("note", Duty.NOTE, [*note, *types(self._gives_first)])
        self._asked_first = w.make("asked", Duty.NOTE, [robot, number, *keys_one])
        self._asked_last = w.make("asked", Duty.NOTE, [robot, number, *types(self._home_keys)])
        self._want_first = w.make("want", Duty.NOTE, [robot, *keys_one])
        self._want_last = w.make("want", Duty.NOTE, [robot, *keys_two])
        self._have_first = w.make("have", Duty.MESSAGE, [robot, number, *keys_one])
        self._have_last = w.make("have", Duty.MESSAGE, [robot, number, *types(self._home_keys)])
        self._offer = w.make("offer", Duty.MESSAGE, [robot, number, number, number, *keys_two, *types(self._extras)])
        given = types(self._gives_last)
        self._stands = w.make("stands", Duty.NOTE, [robot, number, number, *given]) if self._theirs_last else ""
        self._hold = w.make("held", Duty.NOTE, [robot, number, number, *types(self._held)]) if self._stands else ""
        duty = Duty.DECISION if self._stands else Duty.MESSAGE
        self._fired = w.make("fired", duty, [number, number, *given], other=self._stands or None)
        carried = types(self._carried)
        self._did = w.make("did", Duty.NOTE, [robot, number, number, *carried])
        self._settled = w.make("settled", Duty.NOTE, [robot, robot, number, number, *carried])
        self._commit = w.make("commit", Duty.DECISION, [robot, number, number, *carried], other=self._settled)
        self._abort = w.make("abort", Duty.MESSAGE, [robot, number, number])
        self._closing = w.make("closing", Duty.NOTE, [number, robot, robot])
        self._forget = w.make("forget", Duty.MESSAGE, [robot, number, number])
        self._ask = w.make("ask", Duty.MESSAGE, [robot, robot, number, number, number])
        self._asking = w.make("asking", Duty.NOTE, [robot, number, number, number])
        w.must_fit(f"what {called(self._first.owner)} is to reserve", self._keys_first, 20)
        w.must_fit(f"what is offered to {called(self._last.owner)}", [*self._keys_last, *self._extras], 9)
        w.must_fit(f"what {called(self._last.owner)} answers", self._gives_last, 4)

    def rules(self) -> list[RuleItem]:
        """Return the rules, those that answer another robot first."""
        return [
            *self._at_first(),
            *self._at_last(),
            *self._settling(),
            *self._outcomes(),
            *self._ends(),
            *self._grants(),
            self._greet(self._first.owner),
            self._greet(self._last.owner),
            self._draw(),
        ]

    # ---- pieces

    def _numbers(self, count: int) -> tuple[Variable, ...]:
        return tuple(self._w.new(INT) for _ in range(count))

    def _anything(self, places: Sequence[object]) -> list[Expression]:
        return [self._w.variable("_") for _ in places]

    def _id(self, robot: Expression) -> Expression:
        return Call(Name("id", self._w.at), (robot,), self._w.at)

    def _none(self, *body: Conjunct) -> FoldNode:
        return FoldNode(Name("count", self._w.at), None, body, self._w.at)

    def _absent(self, fact: FactNode) -> FactNode:
        return replace(fact, absent=True)

    def _aside(self, facts: Iterable[FactNode], owner: Expression, number: Expression) -> list[FactNode]:
        w = self._w
        return [w.fact(w.writer.aside(each.name.text, w.at)[0], owner, number, *each.arguments[1:]) for each in facts]

    def _returned(self, facts: Iterable[FactNode], *, kept: bool = False) -> list[FactNode]:
        """Return what brings facts back: all, or only those that the rule keeps."""
        w = self._w
        return [
            w.fact(w.writer.aside(each.name.text, w.at)[1], *each.arguments)
            for each in facts
            if each.mark is Mark.KEEP or not kept
        ]

    @staticmethod
    def _taken(facts: Iterable[FactNode]) -> list[FactNode]:
        return [replace(fact, mark=Mark.NONE) if fact.mark is Mark.KEEP else fact for fact in facts]

    def _busy(self, owner: Expression) -> FoldNode:
        """Return the condition that a robot does not wait for the home of an offer to be answered first."""
        lower = self._w.test("<", self._id(self._home), self._id(owner))
        return self._none(self._w.shared("out", owner, self._w.variable("_")), lower)

    # ---- at the first robot

    def _at_first(self) -> list[RuleItem]:
        w = self._w
        home = self._home
        me = self._first.owner
        last = self._last.owner
        life, number, mine, real, other = self._numbers(5)
        keys = w.variables(self._keys_first)
        reserve = w.fact(self._reserve, me, home, life, number, mine, last, other, *keys)
        here = w.shared("life", me, mine)
        tests: list[Conjunct] = [*self._with_first, *self._first.absent]
        values = w.variables(self._booked_values)
        booked = w.fact(self._booked, me, home, life, number, last, other, *values)
        aside = self._aside(self._set_first, me, number)
        answer = w.fact(self._reserved, home, life, number, *w.variables(self._gives_first))
        refusal = w.fact(self._refused_first, home, life, number)
        wish = w.fact(self._want_first, me, home, *keys)
        kept: list[Conjunct] = [*w.kept(self._first.facts), *tests]
        granted = w.fact(self._have_first, home, me, mine, *keys)
        commit = w.fact(self._commit, me, home, life, number, *w.variables(self._carried))
        abort = w.fact(self._abort, me, home, life, number)
        anything = self._anything(self._carried)
        any_commit = w.fact(self._commit, me, home, life, number, *anything)
        no_booking = self._absent(
            w.fact(self._booked, me, home, life, number, *self._anything([0, 0, *self._booked_values]))
        )
        elsewhere = w.test("!=", mine, real)
        stale: list[Conjunct] = [reserve, w.shared("life", me, real), elsewhere]
        return [
            w.rule([reserve, here, *self._taken(self._first.facts), *tests], [booked, *aside, answer]),
            w.rule([reserve, here, self._none(*kept), self._busy(me)], [refusal, wish]),
            w.rule(stale, [refusal, w.shared("knows", home, me, real)]),
            w.rule([wish, here, *kept], [granted]),
            w.rule([commit, booked, *aside], [*self._returned(self._set_first, kept=True), *self._theirs_first]),
            w.rule([abort, booked, *aside], self._returned(self._set_first)),
            w.rule([any_commit, no_booking], []),
            w.rule([abort, no_booking], []),
            *self._asks(booked, life, number, other),
        ]

    def _asks(self, booked: FactNode, life: Variable, number: Variable, other: Variable) -> list[RuleItem]:
        """Return the rules by which the first robot asks the other one after the home has died."""
        w = self._w
        home = self._home
        me = self._first.owner
        last = self._last.owner
        newer, then, since = self._numbers(3)
        held = replace(booked, mark=Mark.KEEP)
        dead: list[Conjunct] = [w.shared("knows", me, home, newer), w.test("<", life, newer)]
        any_commit = w.fact(self._commit, me, home, life, number, *self._anything(self._carried), absent=True)
        open_yet: list[Conjunct] = [any_commit, w.fact(self._abort, me, home, life, number, absent=True)]
        asking = w.fact(self._asking, me, home, life, number, since)
        first_time = w.fact(self._asking, me, home, life, number, w.variable("_"), absent=True)
        ask = w.fact(self._ask, last, me, home, life, number, other)
        never = w.fact(self._asking, me, home, life, number, Literal(-1, w.at))
        again: list[Conjunct] = [asking, w.shared("knows", me, last, then), w.test("<", since, then)]
        no_booking = self._absent(
            w.fact(self._booked, me, home, life, number, *self._anything([0, 0, *self._booked_values]))
        )
        return [
            w.rule([held, *dead, *open_yet, first_time], [never, ask]),
            w.rule([held, *again, *open_yet], [replace(asking, arguments=(*asking.arguments[:-1], then)), ask]),
            w.rule([asking, no_booking], []),
        ]

    # ---- at the last robot

    def _at_last(self) -> list[RuleItem]:
        w = self._w
        home = self._home
        me = self._last.owner
        first = self._first.owner
        life, number, mine, real = self._numbers(4)
        keys = w.variables(self._keys_last)
        extras = w.variables(self._extras)
        offer = w.fact(self._offer, me, home, life, number, mine, *keys, *extras)
        here = w.shared("life", me, mine)
        tests: list[Conjunct] = [*self._with_last, *self._last.absent]
        kept: list[Conjunct] = [*w.kept(self._last.facts), *tests]
        answer = w.fact(self._fired, home, life, number, *w.variables(self._gives_last))
        did = w.fact(self._did, me, home, life, number, *w.variables(self._carried))
        held = w.fact(self._hold, me, home, life, number, *w.variables(self._held)) if self._hold else None
        refusal = w.fact(self._refused_last, home, life, number)
        wish = w.fact(self._want_last, me, home, *keys)
        granted = w.fact(self._have_last, home, me, mine, *w.variables(self._home_keys))
        stale: list[Conjunct] = [offer, w.shared("life", me, real), w.test("!=", mine, real)]
        rules = [
            w.rule([offer, here, *self._last.facts, *tests], [*([held] if held else []), did, answer]),
            w.rule([offer, here, self._none(*kept), self._busy(me)], [refusal, wish]),
            w.rule(stale, [refusal, w.shared("knows", home, me, real)]),
            w.rule([wish, here, *kept], [granted]),
        ]
        if held:
            stands = w.fact(self._stands, me, home, life, number, *self._anything(self._gives_last))
            rules.append(w.rule([stands, held], self._theirs_last))
            rules.append(w.rule([held, w.test("=", home, me)], self._theirs_last))
        # What the first robot asks after the home has died.
        newer = w.new(INT)
        ask = w.fact(self._ask, me, first, home, life, number, mine)
        commit = w.fact(self._commit, first, home, life, number, *w.variables(self._carried))
        abort = w.fact(self._abort, first, home, life, number)
        none_did = w.fact(self._did, me, home, life, number, *self._anything(self._carried), absent=True)
        none_offered = w.fact(
            self._offer,
            me,
            home,
            life,
            number,
            *self._anything([0, *self._keys_last, *self._extras]),
            absent=True,
        )
        nothing: list[Conjunct] = [ask, none_did, none_offered]
        # No offer of the dead life can come any more, or none that names this life.
        heard: list[Conjunct] = [w.shared("knows", me, home, newer), w.test("<", life, newer)]
        another: list[Conjunct] = [w.shared("life", me, real), w.test("<", mine, real)]
        rules.append(w.rule([ask, replace(did, mark=Mark.KEEP)], [commit]))
        rules.append(w.rule([*nothing, *heard], [abort]))
        rules.append(w.rule([*nothing, *another], [abort]))
        return rules

    # ---- when all know the decision

    def _settling(self) -> list[RuleItem]:
        w = self._w
        home = self._home
        first = self._first.owner
        last = self._last.owner
        life, number = self._numbers(2)
        anything = self._anything(self._carried)
        closing = w.fact(self._closing, home, number, first, last)
        forget = w.fact(self._forget, last, home, life, number)
        told_home = w.fact(self._settled, home, first, home, life, number, *anything)
        told_last = w.fact(self._settled, last, first, home, life, number, *anything)
        did = w.fact(self._did, last, home, life, number, *anything)
        other = w.test("!=", home, last)
        itself: list[Conjunct] = [closing, w.shared("life", home, life), w.test("=", home, first)]
        return [
            w.rule([told_home, closing], [forget]),
            w.rule(itself, [forget]),
            w.rule([told_last, other, did], []),
            w.rule([told_last, other, self._absent(did)], []),
            w.rule([forget, did], []),
            w.rule([forget, self._absent(did)], []),
        ]

    # ---- at home

    def _outcomes(self) -> list[RuleItem]:
        w = self._w
        home = self._home
        first = self._first.owner
        last = self._last.owner
        life, number, one, two = self._numbers(4)
        gives_first = w.variables(self._gives_first)
        noted = w.variables(self._noted)
        note = w.fact(self._note, home, number, first, one, last, two, *noted)
        offered = w.fact(self._note_offered, home, number, first, one, last, two, *noted, *gives_first)
        mine = w.shared("life", home, life)
        aside = [*self._aside(self._set_home, home, number), w.shared("out", home, number)]
        back = self._returned(self._set_home)
        reserved = w.fact(self._reserved, home, life, number, *gives_first)
        offer = w.fact(
            self._offer, last, home, life, number, two, *w.variables(self._keys_last), *w.variables(self._extras)
        )
        fired = w.fact(self._fired, home, life, number, *w.variables(self._gives_last))
        refused_first = w.fact(self._refused_first, home, life, number)
        refused_last = w.fact(self._refused_last, home, life, number)
        may_first = w.fact(self._have_first, home, first, one, *w.variables(self._keys_first))
        may_last = w.fact(self._have_last, home, last, two, *w.variables(self._home_keys))
        commit = w.fact(self._commit, first, home, life, number, *w.variables(self._carried))
        abort = w.fact(self._abort, first, home, life, number)
        closing = w.fact(self._closing, home, number, first, last)
        kept = self._returned(self._set_home, kept=True)
        return [
            w.rule([reserved, mine, note], [offered, offer]),
            w.rule([fired, mine, offered, *aside], [may_first, may_last, closing, commit, *kept, *self._ours]),
            w.rule([refused_first, mine, note, *aside], [may_last, *back]),
            w.rule([refused_last, mine, offered, *aside], [may_first, abort, *back]),
        ]

    def _ends(self) -> list[RuleItem]:
        """Return the rules for lives that have ended: of a robot that was asked, and of this one."""
        w = self._w
        home = self._home
        first = self._first.owner
        last = self._last.owner
        life, number, one, two, real = self._numbers(5)
        noted = w.variables(self._noted)
        note = w.fact(self._note, home, number, first, one, last, two, *noted)
        offered = w.fact(
            self._note_offered, home, number, first, one, last, two, *noted, *w.variables(self._gives_first)
        )
        mine = w.shared("life", home, life)
        aside = [*self._aside(self._set_home, home, number), w.shared("out", home, number)]
        back = self._returned(self._set_home)
        may_first = w.fact(self._have_first, home, first, one, *w.variables(self._keys_first))
        may_last = w.fact(self._have_last, home, last, two, *w.variables(self._home_keys))
        abort = w.fact(self._abort, first, home, life, number)
        reserved = w.fact(self._reserved, home, life, number, *self._anything(self._gives_first))
        fired = w.fact(self._fired, home, life, number, *self._anything(self._gives_last))
        refusals = [w.fact(each, home, life, number) for each in (self._refused_first, self._refused_last)]
        ended_first: list[Conjunct] = [w.shared("knows", home, first, real), w.test("<", one, real)]
        ended_last: list[Conjunct] = [w.shared("knows", home, last, real), w.test("<", two, real)]
        any_note = w.fact(self._note, home, number, *self._anything([0, 0, 0, 0, *self._noted]), absent=True)
        places: list[object] = [0, 0, 0, 0, *self._noted, *self._gives_first]
        any_offered = w.fact(self._note_offered, home, number, *self._anything(places), absent=True)
        elsewhere: list[Conjunct] = [w.shared("life", home, real), w.test("!=", life, real)]
        return [
            w.rule([mine, note, *ended_first, self._absent(reserved), *aside], [may_last, *back]),
            w.rule([mine, offered, *ended_last, self._absent(fired), *aside], [may_first, abort, *back]),
            w.rule([refusals[0], mine, any_note], []),
            w.rule([refusals[1], mine, any_offered], []),
            *[w.rule([each, *elsewhere], []) for each in (reserved, fired, *refusals)],
        ]

    def _grants(self) -> list[RuleItem]:
        w = self._w
        (life,) = self._numbers(1)
        rules = []
        for owner, have, asked, names in (
            (self._first.owner, self._have_first, self._asked_first, self._keys_first),
            (self._last.owner, self._have_last, self._asked_last, self._home_keys),
        ):
            granted = w.fact(have, self._home, owner, life, *w.variables(names))
            mark = w.fact(asked, self._home, owner, life, *w.variables(names))
            rules.append(w.rule([granted, mark], []))
            rules.append(w.rule([granted, self._absent(mark)], []))
        return rules

    def _own_part(self, facts: Iterable[FactNode]) -> list[Conjunct]:
        plan = self._w.plan
        order = self._w.test("<", self._id(self._first.owner), self._id(self._last.owner))
        return [*facts, *self._here, order, *plan.folds, *plan.absent]

    def _greet(self, other: Variable | Literal) -> RuleItem:
        w = self._w
        fresh = w.shared("knows", self._home, other, w.variable("_"), absent=True)
        once = w.shared("greeted", self._home, other, absent=True)
        head = [w.shared("greeted", self._home, other), w.shared("hello", other, self._home)]
        return w.rule([*self._own_part(w.kept(self._facts)), fresh, once], head)

    def _draw(self) -> RuleItem:
        w = self._w
        home = self._home
        first = self._first.owner
        last = self._last.owner
        life, number, one, two = self._numbers(4)
        keys = w.variables(self._keys_first)
        asked_first = w.fact(self._asked_first, home, first, one, *keys)
        asked_last = w.fact(self._asked_last, home, last, two, *w.variables(self._home_keys))
        body = [
            *self._own_part(self._taken(self._facts)),
            w.shared("knows", home, first, one),
            w.shared("knows", home, last, two),
            w.shared("life", home, life),
            w.shared("count", home, number),
            self._absent(asked_first),
            self._absent(asked_last),
        ]
        head: list[HeadItem] = [
            w.shared("count", home, Binary("+", number, Literal(1, w.at), w.at)),
            w.shared("out", home, number),
            *self._aside(self._set_home, home, number),
            w.fact(self._note, home, number, first, one, last, two, *w.variables(self._noted)),
            asked_first,
            asked_last,
            w.fact(self._reserve, first, home, life, number, one, last, two, *keys),
        ]
        return w.rule(body, head)


def _name(owner: Variable | Literal) -> str:
    return owner.name if isinstance(owner, Variable) else ""
