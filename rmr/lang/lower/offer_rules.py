"""The rules for one remote robot that decides (the protocol of `ensemble_rules`)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from rmr.bytecode.program import Duty
from rmr.lang.lower.ensemble_writer import INT, ROBOT_TYPE, RuleWriter
from rmr.lang.lower.joint_plan import (
    RemotePart,
    called,
    head_at,
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
    FoldNode,
    HeadItem,
    Literal,
    Mark,
    Name,
    RuleItem,
    Variable,
)


class OfferRules:
    """The rules for one remote that decides."""

    def __init__(
        self,
        writer: RuleWriter,
        part: RemotePart,
        facts: list[FactNode],
        here: list[Condition],
        there: list[Condition],
        known: set[str],
    ) -> None:
        self._w = writer
        self._part = part
        self._facts = facts
        self._here = here
        self._there = there
        plan = writer.plan
        self._home: Variable | Literal = plan.home
        self._remote: Variable | Literal = part.owner
        ends = {each.name for each in (self._home, self._remote) if isinstance(each, Variable)}
        used = list(names_in((part.facts, part.absent, tuple(there))))
        self._keys = [name for name in used if name in known and name not in ends]
        """Values that decide whether the remote's part matches."""
        self._theirs: list[HeadItem] = [item for item in plan.rule.head if head_at(item, self._remote)]
        self._ours: list[HeadItem] = [item for item in plan.rule.head if item not in self._theirs]
        bound = known_from(part.facts, there, known) - known
        self._gives = [name for name in names_in(tuple(self._ours)) if name in bound and name not in ends]
        """Values of the remote that the home's part of the head needs."""
        wanted = [name for name in names_in(tuple(self._theirs)) if name not in ends]
        self._extras = [name for name in wanted if name in known and name not in self._keys]
        """Values of the home that the remote's part of the head needs."""
        self._held = [name for name in wanted if name in known or name in bound]
        self._consumed = [fact for fact in facts if writer.consumable(fact)]
        noted = [name for name in names_in((tuple(self._consumed), tuple(self._ours))) if name in known]
        self._noted = list(dict.fromkeys([*[name for name in noted if name not in ends], *self._keys]))
        self._make()

    def _make(self) -> None:
        w = self._w
        types = w.type
        kept = [types(name) for name in self._keys]
        given = [types(name) for name in self._gives]
        self._offer = w.make(
            "offer", Duty.MESSAGE, [ROBOT_TYPE, INT, INT, INT, *kept, *[types(name) for name in self._extras]]
        )
        self._note = w.make("note", Duty.NOTE, [INT, ROBOT_TYPE, INT, *[types(name) for name in self._noted]])
        self._asked = w.make("asked", Duty.NOTE, [ROBOT_TYPE, INT, *kept])
        self._want = w.make("want", Duty.NOTE, [ROBOT_TYPE, *kept])
        self._have = w.make("have", Duty.MESSAGE, [ROBOT_TYPE, INT, *kept])
        self._refused = w.make("refused", Duty.MESSAGE, [INT, INT])
        self._stands = self._hold = ""
        if self._theirs:
            self._stands = w.make("stands", Duty.NOTE, [ROBOT_TYPE, INT, INT, *given])
            self._hold = w.make("held", Duty.NOTE, [ROBOT_TYPE, INT, INT, *[types(name) for name in self._held]])
        duty = Duty.DECISION if self._theirs else Duty.MESSAGE
        self._fired = w.make("fired", duty, [INT, INT, *given], other=self._stands or None)
        who = called(self._remote)
        w.must_fit(f"what is offered to {who}", [*self._keys, *self._extras], 9)
        w.must_fit(f"what {who} answers", self._gives, 4)

    def rules(self) -> list[RuleItem]:
        """Return the rules, those that answer another robot first."""
        return [
            *self._answers(),
            *self._outcomes(),
            self._greet(),
            self._draw(),
        ]

    # ---- at the remote

    def _answers(self) -> list[RuleItem]:
        w = self._w
        home = self._home
        remote = self._remote
        life, number, mine, real = (w.new(INT) for _ in range(4))
        keys = w.variables(self._keys)
        offer = w.fact(self._offer, remote, home, life, number, mine, *keys, *w.variables(self._extras))
        here = w.shared("life", remote, mine)
        part: list[Conjunct] = [*self._part.facts, *self._there, *self._part.absent]
        held = w.fact(self._hold, remote, home, life, number, *w.variables(self._held)) if self._theirs else None
        answer = w.fact(self._fired, home, life, number, *w.variables(self._gives))
        rules = [w.rule([offer, here, *part], [answer] if held is None else [held, answer])]
        # The remote's own offers are out: its facts may come back, and it waits for that before it refuses a robot with
        # a lower number. Waiting leads from lower to higher numbers only, so it ends.
        busy = w.shared("out", remote, w.variable("_"))
        lower = w.test("<", self._id(home), self._id(remote))
        no_part = self._none([*w.kept(self._part.facts), *self._there, *self._part.absent])
        refusal = w.fact(self._refused, home, life, number)
        wish = w.fact(self._want, remote, home, *keys)
        rules.append(w.rule([offer, here, no_part, self._none([busy, lower])], [refusal, wish]))
        elsewhere = w.test("!=", mine, real)
        news = w.shared("knows", home, remote, real)
        rules.append(w.rule([offer, w.shared("life", remote, real), elsewhere], [refusal, news]))
        granted = w.fact(self._have, home, remote, mine, *keys)
        kept: list[Conjunct] = [*w.kept(self._part.facts), *self._there, *self._part.absent]
        rules.append(w.rule([wish, here, *kept], [granted]))
        if held is not None:
            stands = w.fact(self._stands, remote, home, life, number, *self._anything(self._gives))
            rules.append(w.rule([stands, held], self._theirs))
            # An offer to itself: no radio, no acknowledgement.
            itself = w.test("=", home, remote)
            rules.append(w.rule([held, itself], self._theirs))
        return rules

    def _id(self, robot: Expression) -> Expression:
        return Call(Name("id", self._w.at), (robot,), self._w.at)

    def _none(self, body: Sequence[Conjunct]) -> FoldNode:
        """Return the condition that `body` has no match."""
        return FoldNode(Name("count", self._w.at), None, tuple(body), self._w.at)

    # ---- at home

    def _outcomes(self) -> list[RuleItem]:
        w = self._w
        home = self._home
        remote = self._remote
        life, number, mine, real = (w.new(INT) for _ in range(4))
        keys = w.variables(self._keys)
        lives = w.shared("life", home, life)
        fired = w.fact(self._fired, home, life, number, *w.variables(self._gives))
        refused = w.fact(self._refused, home, life, number)
        aside = [w.fact(self._aside(fact)[0], home, number, *fact.arguments[1:]) for fact in self._consumed]
        note = w.fact(self._note, home, number, remote, mine, *w.variables(self._noted))
        held: list[Conjunct] = [lives, note, *aside, w.shared("out", home, number)]
        granted = w.fact(self._have, home, remote, mine, *keys)
        back = [self._returned(fact) for fact in self._consumed]
        kept = [self._returned(fact) for fact in self._consumed if fact.mark is Mark.KEEP]
        rules = [
            w.rule([fired, *held], [granted, *kept, *self._ours]),
            w.rule([refused, *held], back),
        ]
        asked = w.fact(self._asked, home, remote, mine, *keys)
        rules.append(w.rule([granted, asked], []))
        rules.append(w.rule([granted, replace(asked, absent=True)], []))
        # The life that was asked has ended. Nothing of it arrives any more: this robot has heard of the next one.
        following = w.new(INT)
        next_life = w.shared("knows", home, remote, following)
        ended = w.test("<", mine, following)
        undecided = replace(w.fact(self._fired, home, life, number, *self._anything(self._gives)), absent=True)
        rules.append(w.rule([*held, next_life, ended, undecided], back))
        # A second refusal: the offer reached two lives of the remote.
        any_note = w.fact(self._note, home, number, *self._anything([remote, mine, *self._noted]))
        rules.append(w.rule([refused, lives, replace(any_note, absent=True)], []))
        # What is about an earlier life of this robot.
        elsewhere = w.test("!=", life, real)
        late = [w.rule([each, w.shared("life", home, real), elsewhere], []) for each in (fired, refused)]
        return [*rules, *late]

    def _anything(self, places: Sequence[object]) -> list[Expression]:
        return [self._w.variable("_") for _ in places]

    def _aside(self, fact: FactNode) -> tuple[str, str]:
        return self._w.writer.aside(fact.name.text, self._w.at)

    def _returned(self, fact: FactNode) -> FactNode:
        return self._w.fact(self._aside(fact)[1], *fact.arguments)

    def _own_part(self, facts: Iterable[FactNode]) -> list[Conjunct]:
        plan = self._w.plan
        return [*facts, *self._here, *plan.folds, *plan.absent]

    def _greet(self) -> RuleItem:
        """Return the rule that asks a remote which life it is in, once, before the first offer."""
        w = self._w
        home = self._home
        remote = self._remote
        fresh = w.shared("knows", home, remote, w.variable("_"), absent=True)
        once = w.shared("greeted", home, remote, absent=True)
        head = [w.shared("greeted", home, remote), w.shared("hello", remote, home)]
        return w.rule([*self._own_part(w.kept(self._facts)), fresh, once], head)

    def _draw(self) -> RuleItem:
        w = self._w
        home = self._home
        remote = self._remote
        life, number, mine = (w.new(INT) for _ in range(3))
        keys = w.variables(self._keys)
        taken = [replace(fact, mark=Mark.NONE) if fact.mark is Mark.KEEP else fact for fact in self._facts]
        asked = w.fact(self._asked, home, remote, mine, *keys)
        body = [
            *self._own_part(taken),
            w.shared("knows", home, remote, mine),
            w.shared("life", home, life),
            w.shared("count", home, number),
            replace(asked, absent=True),
        ]
        following = Binary("+", number, Literal(1, w.at), w.at)
        head: list[HeadItem] = [
            w.shared("count", home, following),
            w.shared("out", home, number),
            *[w.fact(self._aside(fact)[0], home, number, *fact.arguments[1:]) for fact in self._consumed],
            w.fact(self._note, home, number, remote, mine, *w.variables(self._noted)),
            asked,
            w.fact(self._offer, remote, home, life, number, mine, *keys, *w.variables(self._extras)),
        ]
        return w.rule(body, head)
