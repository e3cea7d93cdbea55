"""A question: a fact, goal or action with variables, of one robot or of any."""

from typing import NamedTuple

from rmr.base.ids import named
from rmr.base.printable import one_line
from rmr.base.values import Robot, Value
from rmr.bytecode.program import SELF_SLOT, Constant, Kind, Pattern, Program
from rmr.lang.fact_text import FactError, fact_pattern
from rmr.vm.match import pattern_agrees
from rmr.why.rule_words import item_text


class WhyError(Exception):
    """A question that cannot be asked: one sentence with what to do."""


class Question(NamedTuple):
    """What is to be explained."""

    predicate: int
    goal: bool
    action: bool
    owner: int | None
    """None: any robot."""
    args: tuple[Pattern, ...]
    """Slot 0 is the owner."""

    def matches(self, owner: int, args: tuple[Value, ...]) -> bool:
        """Return whether the fact or action of `owner` is meant."""
        return self.owner in (None, owner) and pattern_agrees(self.args, args, (Robot(owner),))

    def of(self, robot: int) -> "Question":
        """Return the question about `robot`."""
        own = Constant(Robot(robot))
        args = [own if getattr(each, "index", None) == SELF_SLOT else each for each in self.args]
        return self._replace(owner=robot, args=tuple(args))

    def text(self, program: Program) -> str:
        """Return it in program syntax, variables as ``_``."""
        return item_text(program, self.predicate, self.owner, self.args, "?" if self.goal else "")


def question(text: str, program: Program, robots: list[int], robot: int | None = None) -> Question:
    """Return the question in `text`; with `robot` it is to be about that robot. Raises WhyError."""
    named = None if "(" in text else program.index(text.strip().lstrip("!?"))
    if named is not None:
        slots = ", ".join("_" * (1 + len(program.predicates[named].types)))
        name = _short(text)
        raise WhyError(f"'{name}' is a name: write its robot and arguments, `_` for any: '{name}({slots})'")
    try:
        pattern = fact_pattern(text, program)
    except FactError as error:
        raise WhyError(f"'{_short(text)}': {error}") from None
    action = program.predicates[pattern.predicate].kind is Kind.ACTION
    asked = Question(pattern.predicate, pattern.goal, action, pattern.owner, pattern.args)
    if asked.owner is not None and asked.owner not in robots:
        raise WhyError(f"'{_short(text)}': robot {asked.owner} is not in this run; it has {robots_text(robots)}")
    if robot is None:
        return asked
    if asked.owner not in (None, robot):
        words = "an action" if action else "a goal" if asked.goal else "a fact"
        raise WhyError(
            f"'{_short(text)}' is {words} of robot {asked.owner}, not of robot {robot}: ask robot {asked.owner}"
        )
    return asked.of(robot)


def robots_text(robots: list[int]) -> str:
    """Return ids in words, ``robots 1-6, 9``."""
    return named(sorted(robots)).replace(",", ", ") if robots else "no robots"


def _short(text: str) -> str:
    return one_line(text.strip(), 80)
