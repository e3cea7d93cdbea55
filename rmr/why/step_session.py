"""The commands of `rmr replay RUN --robot N --step`: go to a stop of a robot's past, and ask what was so there.

A session is a position among the stops (`rmr.why.stops`) and breakpoints. It knows neither terminal nor pipe: it takes
lines and gives lines. Going back is going to an earlier stop, so a stop has one text, whichever way it is reached.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any, Final, NamedTuple

from rmr.base.printable import counted
from rmr.base.time import Instant, in_seconds, seconds
from rmr.bytecode.program import Program
from rmr.vm.provenance import ActionRecord, GoalRecord, InsertionRecord
from rmr.why.past import Past
from rmr.why.past_items import PastGoal
from rmr.why.question import Question, WhyError, question
from rmr.why.replayed_histories import ReplayedHistories
from rmr.why.rule_words import rule_name, rule_place_of, seconds_text
from rmr.why.stop_text import agenda_lines, fact_texts, goal_texts, passed_lines, stop_lines
from rmr.why.stops import PastStop, StopKind, Stops, is_hidden, is_sensed, known_text
from rmr.why.why_answer import goal_agrees, why
from rmr.why.why_text import why_text

LISTED_MAX: Final = 12
"""Rules that a message names."""


class StepError(Exception):
    """A command that cannot be carried out as it is written; one sentence with what to do."""


class NowhereError(Exception):
    """A command that is right, and finds nothing to go to; one sentence."""


class _Order(NamedTuple):
    usage: str
    about: str


ORDERS: Final[Mapping[str, _Order]] = {
    "next": _Order("next [N]", "go to the next firing, or the N-th"),
    "input": _Order("input [N]", "go to the next input: sensed, delivered or given facts, the end of an action"),
    "step": _Order("step [N]", "go to the next stop of any kind; also the begin of an action is one"),
    "until": _Order("until FACT", "go to where FACT begins to hold; ?goal is opened, an action is derived"),
    "continue": _Order("continue", "go to the next firing of a rule with a breakpoint"),
    "back": _Order("back [N], back COMMAND", "the same, backwards: back, back 3, back input, back until FACT"),
    "to": _Order("to T", "go to the last stop at or before instant T, forwards or back: to 12.3s"),
    "start": _Order("start", "go before the first stop"),
    "end": _Order("end", "go to the last stop"),
    "show": _Order("show", "show this stop again"),
    "facts": _Order("facts [FACT]", "what the robot knows here, or what of it matches FACT or has that name"),
    "goals": _Order("goals", "the open goals here"),
    "agenda": _Order("agenda", "the rules that are satisfied here, in the engine's order, and which fires next"),
    "passed": _Order("passed", "what the engine passed over for the firing of this stop, and why"),
    "why": _Order("why FACT", "where FACT comes from, as of this instant (rmr why)"),
    "break": _Order("break [PLACE]", "set a breakpoint on the rule at FILE:LINE; alone: list them"),
    "delete": _Order("delete [PLACE]", "delete the breakpoint at PLACE; alone: all of them"),
    "help": _Order("help", "show this list"),
    "quit": _Order("quit", "end"),
}

_STEPS: Final[Mapping[str, tuple[frozenset[StopKind], str]]] = {
    "next": (frozenset({StopKind.FIRING}), "firing"),
    "input": (frozenset({StopKind.INPUT}), "input"),
    "step": (frozenset(StopKind), "stop"),
}
_BACK: Final = ("next", "input", "step", "until", "continue")


class StepSession:
    """One session."""

    def __init__(self, stops: Stops, histories: ReplayedHistories, begin: Instant | None = None) -> None:
        """`stops` has at least one; `histories` are of the same recording; `begin`: where to begin."""
        self._stops = stops
        self._histories = histories
        self._breakpoints: dict[str, None] = {}
        self.at = -1 if begin is None else stops.last_at(begin - 1)
        """Index of the present stop; -1: before the first one."""
        self.over = False

    # -- carrying out -------------------------------------------------------------------------------------------------

    @property
    def prompt(self) -> str:
        """What stands before a command: the instant of the present stop."""
        now = 0.0 if self.at < 0 else in_seconds(self._stops.all[self.at].at)
        return f"@{self._stops.robot} {now:.3f} s> "

    def about(self) -> Iterator[str]:
        """Yield what there is to step through."""
        stops = self._stops.all
        firings = len([stop for stop in stops if stop.kind is StopKind.FIRING])
        inputs = len([stop for stop in stops if stop.kind is StopKind.INPUT])
        lives = len({part.epoch for part in self._stops.parts})
        more = f" in {lives} lives" if lives > 1 else ""
        span = f"{seconds_text(stops[0].at)} to {seconds_text(self._stops.known_until)}"
        yield f"robot {self._stops.robot}, {span}{more}: {counted(firings, 'firing')}, {counted(inputs, 'input')}"

    def perform(self, line: str) -> Iterator[str]:
        """Carry out a command; yield what it prints. Raises StepError, NowhereError."""
        word, _, rest = line.strip().partition(" ")
        name = _meant(word)
        rest = rest.strip()
        if name in _STEPS or name in ("until", "continue"):
            self._go(name, rest, forwards=True)
        elif name == "back":
            again, _, more = rest.partition(" ")
            way = "next" if not rest or again.isdecimal() else _meant(again)
            if way not in _BACK:
                raise StepError(
                    f"'back {again}' is no way back: back [N], {', '.join(f'back {each}' for each in _BACK)}"
                )
            self._go(way, rest if again.isdecimal() else more.strip(), forwards=False)
        elif name in ("to", "start", "end"):
            yield from self._jump(name, rest)
        else:
            yield from self._asked(name, rest)
            return
        yield from self._shown()

    def _shown(self) -> Iterator[str]:
        yield from stop_lines(self._stops, self.at, self._histories.variables)

    def _asked(self, name: str, rest: str) -> Iterator[str]:
        """Carry out a command that goes nowhere."""
        if rest and name in ("show", "goals", "agenda", "passed", "help", "quit"):
            raise StepError(f"'{name}' stands alone, without '{rest:.40}'")
        match name:
            case "show":
                yield from self._shown()
            case "facts":
                yield from self._facts(rest)
            case "goals":
                yield from goal_texts(self._stops, self.at) or ["no goal is open"]
            case "agenda":
                yield from agenda_lines(self._stops, self.at)
            case "passed":
                if self.at < 0 or self._stops.all[self.at].firing is None:
                    raise StepError("this stop is no firing: go to one with 'next', then ask what was passed over")
                yield from passed_lines(self._stops, self.at)
            case "why":
                yield from self._why(rest)
            case "break":
                yield from self._break(rest)
            case "delete":
                yield from self._delete(rest)
            case "help":
                width = max(len(order.usage) for order in ORDERS.values())
                yield from (f"{order.usage:{width}}  {order.about}" for order in ORDERS.values())
                yield "A command may be shortened as long as it is clear which one is meant: n, i, ag."
            case _:
                self.over = True

    def as_data(self) -> dict[str, Any]:
        """Return what `show`, `facts`, `goals`, `agenda` and `passed` tell at the present stop, and the rules."""
        stops = self._stops.all
        stop = stops[self.at] if self.at >= 0 else None
        by_rules, sensed = fact_texts(self._stops, self.at)
        fires = Counter(self._place_of(each) for each in stops if each.firing is not None)
        return {
            "robot": self._stops.robot,
            "at": self.at,
            "stops": len(stops),
            "t": 0.0 if stop is None else in_seconds(stop.at),
            "about": " ".join(self.about()),
            "stop": list(self._shown()),
            "facts": by_rules,
            "sensed": sensed,
            "goals": goal_texts(self._stops, self.at),
            "agenda": list(agenda_lines(self._stops, self.at)),
            "passed": None if stop is None or stop.firing is None else list(passed_lines(self._stops, self.at)),
            "rules": [{"rule": place, "fires": fires[place]} for place in self._places()],
        }

    # -- going --------------------------------------------------------------------------------------------------------

    def _go(self, name: str, rest: str, *, forwards: bool) -> None:
        if name in _STEPS:
            kinds, what = _STEPS[name]
            self._go_on(_number(name, rest), what, lambda stop: stop.kind in kinds, forwards=forwards)
        elif name == "until":
            self._until(rest, forwards=forwards)
        elif rest:
            raise StepError(f"'continue' stands alone, without '{rest:.40}': set a breakpoint with 'break {rest:.40}'")
        elif not self._breakpoints:
            raise StepError("no breakpoint is set: set one with 'break FILE:LINE', or go to the 'end'")
        else:
            breaks = self._breakpoints
            what = "firing of a rule with a breakpoint"
            self._go_on(1, what, lambda stop: self._place_of(stop) in breaks, forwards=forwards)

    def _go_on(self, count: int, what: str, wanted: Callable[[PastStop], bool], *, forwards: bool) -> None:
        """Go to the stop that is wanted and comes `count`-th. Raises NowhereError, and stays, if there is none."""
        stops = self._stops.all
        way = range(self.at + 1, len(stops)) if forwards else range(self.at - 1, -1, -1)
        seen = 0
        for index in way:
            if wanted(stops[index]):
                seen += 1
                if seen == count:
                    self.at = index
                    return
        where = "after" if forwards else "before"
        known = f" (it is known until {seconds_text(self._stops.known_until)})" if forwards else ""
        raise NowhereError(
            f"there {'is' if seen == 1 else 'are'} only {counted(seen, what)} {where} this stop{known}"
            if seen
            else f"there is no {what} {where} this stop{known}"
        )

    def _until(self, rest: str, *, forwards: bool) -> None:
        if not rest:
            raise StepError(f"'until' needs a fact, such as {self._example()}")
        asked = self._questions(rest)
        first = next(each for each in asked if each is not None)
        what = "is opened" if first.goal else "is derived" if first.action else "begins to hold"
        self._go_on(1, f"stop where it {what}", lambda stop: self._brings(stop, asked[stop.part]), forwards=forwards)

    def _brings(self, stop: PastStop, asked: Question | None) -> bool:
        """Return whether what is asked for comes at a stop."""
        if asked is None:
            return False
        mind = self._stops.parts[stop.part]
        for record in stop.records:
            match record:
                case InsertionRecord(_, _, predicate, args, _) if not (asked.goal or asked.action):
                    found = predicate == asked.predicate and asked.matches(mind.robot, args)
                case ActionRecord(_, _, predicate, executor, args, _, _) if asked.action:
                    found = predicate == asked.predicate and asked.matches(executor, args)
                case GoalRecord(at, predicate, patterns, cause) if asked.goal and predicate == asked.predicate:
                    found = goal_agrees(asked, PastGoal(0, predicate, patterns, at, 0, cause))
                case _:
                    continue
            if found:
                return True
        return False

    def _questions(self, text: str) -> list[Question | None]:
        """Return what is asked for, for each part that can have it. Raises StepError if none can."""
        found: list[Question | None] = []
        problem = ""
        for part in self._stops.parts:
            try:
                found.append(question(text, part.program, self._histories.robots, self._stops.robot))
            except WhyError as error:
                problem = problem or str(error)
                found.append(None)
        if not any(found):
            raise StepError(problem)
        return found

    def _jump(self, name: str, rest: str) -> Iterator[str]:
        if name != "to":
            if rest:
                raise StepError(f"'{name}' stands alone, without '{rest:.40}'")
            self.at = -1 if name == "start" else len(self._stops.all) - 1
            return
        instant = _instant(rest)
        if instant > self._stops.known_until:
            yield f"the robot is known until {seconds_text(self._stops.known_until)}"
        self.at = self._stops.last_at(instant)

    # -- breakpoints --------------------------------------------------------------------------------------------------

    def _places(self) -> list[str]:
        """Return the rules that can have a breakpoint, in the order of the text."""
        programs = [part.program for part in self._stops.parts]
        return list(dict.fromkeys(_place(each, rule) for each in programs for rule in range(len(each.rules))))

    def _place_of(self, stop: PastStop) -> str | None:
        """Return which rule fires at a stop; None: it is no firing."""
        return None if stop.firing is None else _place(self._stops.parts[stop.part].program, stop.firing.rule)

    def _break(self, rest: str) -> Iterator[str]:
        if not rest:
            yield from self._breakpoints or ["no breakpoint is set"]
            return
        known = self._places()
        wanted = rest.removeprefix("rule ").strip()
        if re.fullmatch("[0-9]+", wanted):  # a line alone, where there is one file
            found = [place for place in known if place.endswith(f":{int(wanted)}")]
        else:
            found = [place for place in known if place == wanted]
        if not found:
            near = get_close_matches(wanted, known, LISTED_MAX, 0.0) if len(known) > LISTED_MAX else known
            rules = ", ".join(place for place in known if place in near)
            raise StepError(f"no rule begins at '{wanted:.60}'; rules: {rules or 'none'}")
        if len(found) > 1:
            raise StepError(f"line {wanted} is the beginning of several rules: {', '.join(found)}")
        self._breakpoints[found[0]] = None
        fired = len([stop for stop in self._stops.all if self._place_of(stop) == found[0]])
        yield f"breakpoint on rule {found[0]}, which fires {counted(fired, 'time')} in all"

    def _delete(self, rest: str) -> Iterator[str]:
        wanted = rest.removeprefix("rule ").strip()
        gone = [place for place in self._breakpoints if not wanted or wanted in (place, place.rpartition(":")[2])]
        if not gone:
            raise StepError(f"there is no breakpoint{f' on {wanted:.60}' if wanted else ''}; 'break' lists them")
        for place in gone:
            del self._breakpoints[place]
            yield f"no breakpoint on rule {place} any more"

    # -- questions ----------------------------------------------------------------------------------------------------

    def _facts(self, rest: str) -> Iterator[str]:
        if rest:
            yield from self._matching(rest)
            return
        by_rules, sensed = fact_texts(self._stops, self.at)
        yield from by_rules or ["no facts"]
        yield from (f"{text}  (sensed)" for text in sensed)

    def _matching(self, rest: str) -> Iterator[str]:
        """Yield the facts that match a pattern, or whose predicate has that name."""
        mind = self._stops.mind(self.at)
        program = mind.program
        index = program.index(rest.lstrip("!")) if "(" not in rest else None
        asked = None
        if index is None:
            try:
                asked = question(rest, program, self._histories.robots, self._stops.robot)
            except WhyError as error:
                raise StepError(str(error)) from None
            if asked.goal or asked.action:
                raise StepError(f"'{rest:.60}' is no fact: 'goals' tells open goals, 'until' goes to an action")
            index = asked.predicate
        texts = [
            known_text(program, index, mind.robot, fact.args) + ("  (sensed)" if is_sensed(program, index) else "")
            for fact in self._stops.held(self.at)
            if fact.predicate == index and (asked is None or asked.matches(mind.robot, fact.args))
        ]
        yield from sorted(texts) or [f"no such fact holds here: {rest:.60}"]

    def _why(self, rest: str) -> Iterator[str]:
        if not rest:
            raise StepError(f"'why' needs a fact, such as {self._example()}")
        if self.at < 0:
            raise StepError("nothing has happened yet: go to a stop first")
        histories = self._histories
        told = len(histories.problems)
        try:
            asked = question(rest, histories.program, histories.robots)
            answer = why(Past(histories, histories.variables), asked, self._stops.all[self.at].at)
            yield from why_text(answer).splitlines()
            yield from histories.problems[told:]
        except WhyError as error:
            raise StepError(str(error)) from None

    def _example(self) -> str:
        """Return a fact of this robot as an example."""
        program = self._stops.mind(self.at).program
        for fact in self._stops.held(len(self._stops.all) - 1):
            if not is_hidden(program, fact.predicate) and fact.predicate < len(program.predicates):
                name = self._stops.mind(len(self._stops.all) - 1).program.predicates[fact.predicate].name
                return f"{name}({', '.join([f'@{self._stops.robot}', *['_'] * len(fact.args)])})"
        return f"at(@{self._stops.robot}, exit)"


def _meant(word: str) -> str:
    """Return the command that is meant by a word or its beginning. Raises StepError."""
    if word in ORDERS:
        return word
    begun = [name for name in ORDERS if word and name.startswith(word)]
    if len(begun) == 1:
        return begun[0]
    if begun:
        raise StepError(f"'{word}' may be {' or '.join(begun)}: write more of it")
    near = get_close_matches(word, ORDERS, 1)
    raise StepError(f"unknown command '{word:.40}'{f'; did you mean {near[0]!r}?' if near else ''}; 'help' lists them")


def _number(name: str, rest: str) -> int:
    if not rest:
        return 1
    if not re.fullmatch("[0-9]{1,9}", rest) or int(rest) == 0:
        raise StepError(f"'{name} {rest:.40}': N is a whole number from 1, of 9 digits at most")
    return int(rest)


def _instant(text: str) -> Instant:
    """Return an instant of lab time. Raises StepError."""
    found = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,9})?) ?(ms|s|min|)", text)
    if found is None:
        raise StepError(f"'to {text:.40}': write an instant of lab time as 12.3s, 500ms or 1.5min")
    return seconds(float(found[1]) * {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0}[found[2]])


def _place(program: Program, rule: int) -> str:
    """Return the name of a rule for breakpoints, ``corridor.rmr:12``."""
    name = rule_name(program, rule)
    return name.removeprefix("rule ") if rule_place_of(program, rule) is not None else name
