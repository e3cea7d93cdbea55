"""`rmr check --explain`: why a program does what it does.

What is told is data (dataclasses that become JSON as they are); show.py puts it into words. Goals and the rules
that lead there come from reach.py, assertions and the actions that serve them from serve.py: the same answers by
which robots choose among rules and hold actions back. Whether all robots can be run at once is found out in
rmr.analysis.column_obstacles.
"""

from dataclasses import dataclass

from rmr.lang.compiler import Compilation
from rmr.lang.explain.assertions import Assertions, ExplainedAssertion
from rmr.lang.explain.columns import ExplainedColumns, explain_columns
from rmr.lang.explain.goals import ExplainedGoal, Goals
from rmr.lang.explain.rules import ExplainedRule, Rules
from rmr.lang.explain.texts import Names, Texts, environments
from rmr.lang.syntax import GoalItem


@dataclass(frozen=True, slots=True)
class Explanation:
    """What there is to say about one program."""

    file: str
    goals: tuple[ExplainedGoal, ...]
    assertions: tuple[ExplainedAssertion, ...]
    rules: tuple[ExplainedRule, ...]
    """In the order of the program; elsewhere rules are told by their place here."""
    columns: ExplainedColumns


def explain(compilation: Compilation) -> Explanation | None:
    """Explain a program without errors; None if it has some."""
    program, checked = compilation.program, compilation.checked
    if program is None or checked is None:
        return None
    texts = Texts(compilation.sources)
    goals = Goals(program, [Names(*environments(each)) for each in checked.rules], texts)
    assertions = Assertions(program, texts)
    rules = Rules(checked, texts)
    stated = [item for item in checked.module.items if isinstance(item, GoalItem)]
    watched = zip(checked.assertions, program.assertions, strict=True)
    return Explanation(
        file=compilation.source.file,
        goals=tuple([goals.explain(*each) for each in zip(stated, program.goals, strict=True)]),
        assertions=tuple([assertions.explain(*each) for each in watched]),
        rules=tuple([rules.explain(each) for each in checked.rules]),
        columns=explain_columns(program),
    )
