"""Rendering of an explanation as text for a terminal; docs/explain.md describes its contents."""

from collections.abc import Iterator, Sequence

from rmr.base.printable import counted, shortened
from rmr.lang.explain import Explanation
from rmr.lang.explain.explained_assertions import ExplainedAssertion, Origin, ServingAction
from rmr.lang.explain.explained_goals import ExplainedGoal, LeadingRule
from rmr.lang.explain.explained_rules import ExplainedDerivation, ExplainedEnsemble, ExplainedPart, ExplainedRule, Needs
from rmr.lang.explain.texts import Spot

RULES_SHOWN_MAX = 50
"""Largest number of rules shown for one goal, nearest first; JSON has them all."""

STEPS_SHOWN_MAX = 20
"""Largest number of rules shown on the path from an effect to the finish fact."""

TEXT_SHOWN_MAX = 100
"""Largest number of characters shown of a rule's text, enough to recognise it."""


OBSTACLES_SHOWN_MAX = 20
"""Largest number of obstacles to columns that are shown."""

LABEL = 11
"""Width of the label of an entry, in columns."""

GOALS = """\
GOALS. The rank of a rule: how many further firings lead from it to the goal. The lowest goes first.
Compiled: the same for every match. Searched: it depends on the match, on the robot, or on the facts that hold then.
A robot takes the shortest way over them; without one an estimate, which takes all other facts for granted."""
ASSERTIONS = "TIME ASSERTIONS. The actions that serve one are held back until it is the robot's turn."
COLUMNS = "COLUMNS. Whether `rmr eval --engine columnar` takes all robots at once."
RULES = "RULES. What they need, what comes of it, and what is sent to whom, with the octets that its values take."

ENSEMBLE = """\
RULES OVER SEVERAL ROBOTS. Where they run, what they ask of whom, and the frames of a firing without loss and
acknowledgements."""


def show(explanation: Explanation) -> str:
    """Return an explanation as text."""
    return "".join(f"{line}\n" for line in _Shown(explanation).lines())


def show_assertion(explanation: Explanation, assertion: ExplainedAssertion) -> str:
    """Return the entry of one of its time assertions as text."""
    return "".join(f"{line}\n" for line in _Shown(explanation).assertion(assertion))


class _Shown:
    def __init__(self, explanation: Explanation) -> None:
        self._explanation = explanation

    def lines(self) -> Iterator[str]:
        """Yield the lines of all sections."""
        explanation = self._explanation
        written = [each for each in explanation.rules if not each.part]
        counts = (
            ([*written, *explanation.ensemble], "rule"),
            (explanation.goals, "goal"),
            (explanation.assertions, "time assertion"),
        )
        yield f"{explanation.file}: " + ", ".join(counted(len(each), word) for each, word in counts)
        for title, entries in (
            (GOALS, [self._goal(each) for each in explanation.goals]),
            (ASSERTIONS, [self.assertion(each) for each in explanation.assertions]),
            (RULES, [self._rule(each) for each in written]),
            (ENSEMBLE, [self._ensemble(each) for each in explanation.ensemble]),
        ):
            if entries:
                yield from ("", title)
            for entry in entries:
                yield ""
                yield from entry
            if title is GOALS and entries:
                yield from self._ranking()
        yield from ("", COLUMNS, "")
        yield from self._columns()

    # ---- goals

    def _goal(self, goal: ExplainedGoal) -> Iterator[str]:
        whose = "every robot's" if goal.robot is None else f"the goal of @{goal.robot}"
        yield f"  {_cut(goal.goal)}  {_place(goal.place)}, {whose}"
        if goal.stated:
            yield "    a stated fact fulfils it at the start"
        if goal.sensed:
            yield "    it is fulfilled when the robot senses it"
        for rule in goal.rules[:RULES_SHOWN_MAX]:
            yield from self._leading(rule)
        more = len(goal.rules[RULES_SHOWN_MAX:]) + goal.rules_left_out
        if more:
            yield f"    and {counted(more, 'more rule')}"
        elif not goal.worked_out:
            yield "    so much leads there that it is not worked out here; robots find out as they go"
        elif not goal.rules:
            yield "    no rule leads there" + (
                "" if goal.stated or goal.sensed else ": only a fact from outside fulfils it"
            )

    def _ranking(self) -> Iterator[str]:
        """Yield the bounds of the search, if a rank is searched for."""
        goals = self._explanation.goals
        if all(goal.worked_out and all(each.rank is not None for each in goal.rules) for goal in goals):
            return
        bounds = self._explanation.ranking
        yield ""
        yield (
            f"  The search takes a robot at most {bounds.steps_per_tick:,} steps a tick; without ranks it waits for "
            f"{bounds.ticks_waited} ticks at most,"
        )
        yield (
            f"  then estimates. It keeps {bounds.steps_kept:,} steps and facts. Estimates take "
            f"{bounds.estimate_steps:,} steps for one set of goals."
        )

    def _leading(self, rule: LeadingRule) -> Iterator[str]:
        explained = self._explanation.rules[rule.rule]
        rank = f"rank {rule.rank_min}" + ("" if rule.rank is not None else " at best")
        yield f"    {rank}, {rule.ranked_by}  {_place(explained.place)}  {_cut(explained.text, TEXT_SHOWN_MAX)}"
        how = "derives" if rule.action is None else f"its action {rule.action} has the effect"
        here = "" if rule.owner is None else f" if {rule.owner} is the robot itself"
        needed = "the goal" if rule.needed_by is None else f"needed by the rule at {self._at(rule.needed_by)}"
        yield f"      {how} {_cut(rule.derives)}{here}, {needed}"

    # ---- time assertions

    def assertion(self, assertion: ExplainedAssertion) -> Iterator[str]:
        """Yield the lines of a time assertion."""
        yield f"  {assertion.name}  {_place(assertion.place)}"
        yield _entry("starts with", assertion.starts_with)
        yield _entry("ends with", f"{assertion.ends_with} within {assertion.deadline}, else {assertion.violation}")
        if assertion.event is not None:
            yield _entry("turns", f"the robots with a job of {assertion.event} take turns")
        elif not assertion.scheduled:
            yield _entry("turns", "none, it is only watched: nothing is held back")
        else:
            yield _entry("turns", "none, it is only watched: no declared effect of an action leads to the finish fact")
        for serving in assertion.serving:
            yield from self._serving(serving)
        for step in assertion.steps:
            yield _entry("step", f"{step}: before that, with turns of its own")
        if assertion.scheduled:
            for origin in assertion.origins:
                yield _entry("", f"{origin.fact}: {self._origin(origin)}")
        if assertion.cut:
            yield _entry("", "so much leads there that not all of it was looked at")

    def _serving(self, serving: ServingAction) -> Iterator[str]:
        yield _entry("served by", serving.action)
        fact = f"its effect {serving.effect}"
        for step in serving.way[:STEPS_SHOWN_MAX]:
            yield _entry("", f"{fact}, needed by the rule at {self._at(step.rule)},")
            fact = f"which derives {step.derives}"
        left_out = len(serving.way[STEPS_SHOWN_MAX:]) + serving.way_left_out
        yield _entry("", f"{fact}, and {counted(left_out, 'more step')}" if left_out else f"{fact}, the finish fact")
        rules = [self._at(each) for each in serving.derived_by]
        yield _entry("", f"derived by {_rules(rules)}" if rules else "no rule of this program derives it")

    def _origin(self, origin: Origin) -> str:
        ways = ["sensed"] if origin.sensed else []
        ways += ["stated"] if origin.stated else []
        ways += [f"derived by {_rules([self._at(each) for each in origin.rules])}"] if origin.rules else []
        return ", ".join(ways) or "nothing in the program brings it about"

    # ---- rules

    def _rule(self, rule: ExplainedRule) -> Iterator[str]:
        yield f"  {_place(rule.place)}  {_cut(rule.text, TEXT_SHOWN_MAX)}"
        yield _entry("runs on", f"{rule.home} alone" if rule.home.startswith("@") else f"every robot, {rule.home}")
        yield from _needs(rule.needs)
        for part in rule.head:
            yield from _part(part)
        if not rule.head:
            yield _entry("derives", "nothing")

    def _ensemble(self, rule: ExplainedEnsemble) -> Iterator[str]:
        yield f"  {_place(rule.place)}  {_cut(rule.text, TEXT_SHOWN_MAX)}"
        yield _entry("home", rule.home)
        for remote in rule.remotes:
            how = "tells once what matches" if remote.told else "decides about an offer of"
            yield _entry("asks", f"{remote.robot}, which {how} {', '.join(remote.facts)}")
            if remote.why:
                yield _entry("", f"not told: {remote.why}")
            if remote.inverted:
                yield _entry("", f"{remote.robot} knows the home by {remote.link}")
            elif remote.link is not None:
                yield _entry("", f"known by {remote.link}")
        costs = [f"{rule.frames} a firing"] if rule.frames else []
        costs += [f"{rule.frames_told} for each match that is told"] if rule.frames_told else []
        yield _entry("frames", ", ".join(costs))
        for who, why in rule.not_home:
            yield _entry("not home", f"{who}: {why}")

    def _at(self, rule: int) -> str:
        return _place(self._explanation.rules[rule].place)

    # ---- columns

    def _columns(self) -> Iterator[str]:
        columns = self._explanation.columns
        if columns.suited:
            yield "  yes: a robot holds at most one fact of each predicate, and each rule changes its own robot alone"
            return
        yield "  no, it takes each by itself:"
        for each in columns.obstacles[:OBSTACLES_SHOWN_MAX]:
            where = "" if each.place is None else f"{_place(each.place)}  "
            yield f"    {where}{_cut(each.text)}"
        more = len(columns.obstacles[OBSTACLES_SHOWN_MAX:]) + columns.obstacles_left_out
        if more:
            yield f"    and {more} more"


def _needs(needs: Needs) -> Iterator[str]:
    said = ("consumes", needs.consumes), ("keeps", needs.keeps), ("reads", needs.reads)
    for label, texts in (*said, ("without", needs.absent), ("if", needs.conditions)):
        if texts:
            yield _entry(label, ", ".join(texts))


def _part(part: ExplainedPart) -> Iterator[str]:
    if part.needs is not None:
        label = "for each match" if part.form == "comprehension" else f"{part.form} of all matches"
        yield f"    {label}"
        yield from (f"  {line}" for line in _needs(part.needs))
    if part.form == "steps":
        yield _entry("in turn", " then ".join(each.text for each in part.derives if each.what != "effect"))
    for each in part.derives:
        if each.to is not None:
            yield _entry("sends", _sent(each))
        elif part.form != "steps":
            yield _entry(
                {"goal": "wants", "action": "does", "withdrawal": "withdraws"}.get(each.what, "derives"), each.text
            )


def _sent(derived: ExplainedDerivation) -> str:
    """Return a fact or action for another robot with its size, and whether one frame holds it."""
    least = derived.octets_min
    most = derived.octets_max
    size = (
        f"{least} octets"
        if least == most
        else f"{least} octets or more"
        if most is None
        else f"{least} to {most} octets"
    )
    room = {True: "one frame", False: "more than one frame", None: f"one frame up to {derived.octets_room}"}
    what = "when that is complete, " if derived.what == "effect" else ""
    return f"{what}{derived.text} to {derived.to}: {size}, {room[derived.fits]}"


# ---- words


def _entry(label: str, text: str) -> str:
    return f"    {label:<{LABEL}} {_cut(text)}"


def _place(spot: Spot) -> str:
    return f"{spot.file}:{spot.line}"


def _rules(places: Sequence[str]) -> str:
    shown = list(places[:10])  # of one sentence
    more = len(places) - len(shown)
    return (
        f"the {'rule' if len(places) == 1 else 'rules'} at " + ", ".join(shown) + (f" and {more} more" if more else "")
    )


def _cut(text: str, limit: int = 500) -> str:
    """Return `text` cut to `limit` characters, with control characters replaced."""
    return "".join(each if each.isprintable() else "\ufffd" for each in shortened(text, limit))
