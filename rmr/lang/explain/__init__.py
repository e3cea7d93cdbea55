"""`rmr check --explain`: why a program does what it does.

An explanation is data (dataclasses that become JSON as they are); `show` renders it as text. The rules that lead to a
goal come from `lower.goal_paths`, the actions that serve a time assertion from `lower.servers`: the same answers by
which robots choose among rules and hold actions back. Whether the program can be run as columns comes from
`rmr.analysis.column_obstacles`.
"""

from dataclasses import dataclass

from rmr.analysis.column_obstacles import Obstacle, obstacles
from rmr.bytecode.program import Program
from rmr.lang.compiler import Compilation
from rmr.lang.explain.explained_assertions import AssertionExplainer, ExplainedAssertion
from rmr.lang.explain.explained_goals import ExplainedGoal, GoalExplainer, RankingBudget
from rmr.lang.explain.explained_rules import ExplainedEnsemble, ExplainedRule, RuleExplainer, explain_ensemble
from rmr.lang.explain.texts import PredicateNames, Spot, Texts, environments
from rmr.lang.read.syntax import GoalItem

OBSTACLES_MAX = 1000
"""Largest number of listed obstacles; of further ones only the number."""


@dataclass(frozen=True, slots=True)
class ExplainedObstacle:
    """A property of the program that rules out columns."""

    text: str
    place: Spot | None
    """The place in the source; None if it concerns the whole program."""


@dataclass(frozen=True, slots=True)
class ExplainedColumns:
    """Whether a program suits columns."""

    suited: bool
    obstacles: tuple[ExplainedObstacle, ...]
    obstacles_left_out: int


def explain_columns(program: Program) -> ExplainedColumns:
    """Return whether `program` suits columns, and if not, why."""
    found = obstacles(program)
    listed = tuple([ExplainedObstacle(each.text, _spot(each)) for each in found[:OBSTACLES_MAX]])
    return ExplainedColumns(not found, listed, len(found) - len(listed))


def _spot(obstacle: Obstacle) -> Spot | None:
    place = obstacle.place
    return None if place is None else Spot(place.file, place.line, place.column)


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of one program."""

    file: str
    goals: tuple[ExplainedGoal, ...]
    ranking: RankingBudget
    assertions: tuple[ExplainedAssertion, ...]
    rules: tuple[ExplainedRule, ...]
    """Rules in the order of the program; other parts refer to a rule by its index here."""
    ensemble: tuple[ExplainedEnsemble, ...]
    """Rules over several robots; what each becomes is among `rules`, marked."""
    columns: ExplainedColumns


def explain(compilation: Compilation) -> Explanation | None:
    """Explain a program without errors; None if it has some."""
    program = compilation.program
    checked = compilation.checked
    if program is None or checked is None:
        return None
    texts = Texts(compilation.sources)
    goals = GoalExplainer(program, [PredicateNames(*environments(each)) for each in checked.rules], texts)
    assertions = AssertionExplainer(program, texts)
    rules = RuleExplainer(checked, texts)
    stated = [item for item in checked.module.items if isinstance(item, GoalItem)]
    watched = zip(checked.assertions, program.assertions, strict=True)
    return Explanation(
        file=compilation.source.file,
        goals=tuple([goals.explain(*each) for each in zip(stated, program.goals, strict=True)]),
        ranking=RankingBudget(),
        assertions=tuple([assertions.explain(*each) for each in watched]),
        rules=tuple([rules.explain(each) for each in checked.rules]),
        ensemble=tuple([explain_ensemble(each, texts) for each in checked.ensemble.plans]),
        columns=explain_columns(program),
    )
