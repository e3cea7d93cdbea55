"""The checker: the semantic analysis of a program, phase by phase; the results are the input of the emitter.

Kinds and arities are checked by `analyse.names`, types by `analyse.inference`, ownership and bound variables by
`lower.projection` and `lower.time_assertions`; warnings come from `analyse.lint`. Checked here are stated facts,
goals, effects and the strategy.
"""

from dataclasses import replace

from rmr.base.record import record
from rmr.base.values import Symbol
from rmr.bytecode.limits import STACK_MAX
from rmr.bytecode.program import Kind, Strategy
from rmr.lang.analyse.bare_conditions import with_conditions
from rmr.lang.analyse.inference import Inference
from rmr.lang.analyse.lint import warn
from rmr.lang.analyse.named_constants import resolve
from rmr.lang.analyse.names import NOTHING_GIVEN, Given, Names, collect, meant
from rmr.lang.analyse.types import DRAWN, TIMED, Types
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics, WordHint
from rmr.lang.lower.ensemble_rules import rewritten
from rmr.lang.lower.ensemble_writer import EnsembleRules, EnsembleWriter
from rmr.lang.lower.far_reads import SharedReader
from rmr.lang.lower.joint_plan import owners_of, with_named_owners
from rmr.lang.lower.joint_rules import JointPlanner
from rmr.lang.lower.ordering import variables
from rmr.lang.lower.projection import Projector
from rmr.lang.lower.robot_rules import Projected
from rmr.lang.lower.time_assertions import Watched, check_names, watched
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    AggregateNode,
    AssertionItem,
    Binary,
    Call,
    ChoiceNode,
    ComprehensionNode,
    Condition,
    ConstantItem,
    Expression,
    FactItem,
    FactNode,
    FoldNode,
    FunctionItem,
    GoalItem,
    IncludeItem,
    Item,
    ListTerm,
    Literal,
    ModuleNode,
    RuleItem,
    StepsNode,
    StrategyItem,
    TypeDeclaration,
    Variable,
    children,
    flat,
    walk,
)

PARTS_MAX = 250
"""Limit for the conjuncts of a body, the items of a head and the arguments of a fact; far above handwritten ones."""

STACK_USED_MAX = STACK_MAX - 8
"""Stack depth of an expression of the source; the margin holds what the compiler adds, such as a comparison."""

STRATEGIES = tuple([each.name.lower() for each in Strategy])


@record
class Checked:
    """The analysed program; items with errors are missing, so it is complete only if no error was reported."""

    module: ModuleNode
    names: Names
    types: Types
    rules: tuple[Projected, ...]
    assertions: tuple[Watched, ...]
    strategy: Strategy
    ensemble: EnsembleRules
    """What rules over several robots have become; it is among `rules` and `names`."""


def check(module: ModuleNode, found: Diagnostics, given: Given = NOTHING_GIVEN, *, closed: bool = False) -> Checked:
    """Analyse `module` and report to `found`; facts of `given` come from outside, if `closed` no others."""
    # The order matters: constants before sizes, names before types, types before projection, warnings last.
    module = resolve(with_conditions(module), found)
    module = replace(module, items=tuple(item for item in module.items if not _too_large(item, found)))
    module, names, types = _analysed(module, found, given)
    names.closed = closed
    symbols = {
        node.value for node in walk(module.items) if isinstance(node, Literal) and isinstance(node.value, Symbol)
    }
    # Ensemble rules add predicates of their own: what the source says is kept apart, for the warnings.
    written = names, types
    names = replace(names, signatures=dict(names.signatures))
    types = replace(types, positions=dict(types.positions))
    projector = Projector(names, types, frozenset(symbols), found)
    planner = JointPlanner(names, found)
    ensemble = EnsembleWriter(names, types)
    shared = SharedReader(names, planner, ensemble, found)
    rules: list[Projected | None] = []
    assertions: list[Watched | None] = []
    for item in module.items:
        match item:
            case FactItem(fact=fact):
                _stated(fact, found)
            case GoalItem(fact=fact):
                _goal(fact, found)
            case TypeDeclaration():
                _effects(item, names, found)
            case RuleItem():
                _untimed(item, found)
                local = shared.at_home(item)
                if local is not None:
                    rules += map(projector.rule, _of_one_robot(local, projector, planner, ensemble, found))
            case FunctionItem():
                _function(item, found)
            case AssertionItem():
                _no_now(item.deadline, found)
                _not_negative(item.deadline, found)
                assertions.append(watched(item, found))
            case ConstantItem() | IncludeItem() | StrategyItem():
                pass
    check_names(module, found)
    if ensemble.result.plans and not found.failed:
        rules += map(projector.rule, ensemble.common(ensemble.result.plans[0].rule.span))
    sound = tuple(each for each in rules if each is not None)
    watches = tuple(each for each in assertions if each is not None)
    checked = Checked(module, names, types, sound, watches, _strategy(module, found), ensemble.result)
    warn(module, *written, found)
    return checked


def _of_one_robot(
    item: RuleItem, projector: Projector, planner: JointPlanner, ensemble: EnsembleWriter, found: Diagnostics
) -> list[RuleItem]:
    """Return the rules of one robot each that a rule becomes: itself, unless it names facts of several robots."""
    if not projector.is_joint(item):
        return [item]
    item = with_named_owners(item)
    plan = planner.plan(item)
    owners = owners_of(item) if plan is None else [plan.home, *[part.owner for part in plan.remotes]]
    is_bound = projector.is_bound(item, owners)
    if plan is None or not is_bound or found.wrong_within(item.span) or not ensemble.knows(item):
        return []  # an error has been told, and the rewriting relies on what that was about
    return rewritten(plan, ensemble, found)


def _analysed(module: ModuleNode, found: Diagnostics, given: Given) -> tuple[ModuleNode, Names, Types]:
    """Return the names and types of a module; after a contradiction of types, those of the repaired module."""
    # On a branch: if a repair explains the contradictions, they are dropped and inference runs again.
    first = found.branch()
    names = collect(module, first, given)
    types = Inference(names, module.broken, first).run(module)
    if first.failed:
        from rmr.lang.analyse.intended_literals import intended  # noqa: PLC0415 - most programs have no contradiction

        meant = intended(module, types, first.errors, found)
        if meant is not module:
            module = meant
            first = found.branch()
            names = collect(module, first, given)
            types = Inference(names, module.broken, first).run(module)
    found.absorb(first)
    return module, names, types


def _too_large(item: Item, found: Diagnostics) -> bool:
    nodes = 0
    for node in walk(item):
        nodes += 1
        count, span = _parts(node)
        if count > PARTS_MAX:
            found.report("E008", f"this has {count} parts, more than {PARTS_MAX}", span or item.span)
            return True
    if nodes > STACK_USED_MAX and _stack(item) > STACK_USED_MAX:
        found.report("E008", "lists within long lists: more values than a robot's stack holds", item.span)
        return True
    return False


def _parts(node: object) -> tuple[int, Span | None]:
    match node:
        case RuleItem(body=body, head=head, span=span):
            return max(len(body), len(head)), span
        case ComprehensionNode(body=body, head=derived, span=span):
            return max(len(body), len(derived)), span
        case AggregateNode(body=body, head=derived, span=span):
            return max(len(body), len(derived)), span
        case ChoiceNode(then=then, otherwise=otherwise, span=span):
            return max(len(then), len(otherwise)), span
        case FoldNode(body=parts, span=span) | StepsNode(derived=parts, span=span):
            return len(parts), span
        case FactNode(arguments=parts, span=span) | Call(arguments=parts, span=span) | ListTerm(items=parts, span=span):
            return len(parts), span
        case TypeDeclaration(parameters=parts, span=span):
            return len(parts), span
        case _:
            return 0, None


def _stack(node: object) -> int:
    """Return the stack depth of an expression's evaluation; the recursion is bounded by the parser."""
    match node:
        case Call(arguments=operands):
            return max((k + _stack(each) for k, each in enumerate(operands)), default=1)
        case ListTerm(items=operands, rest=rest):
            return max(1 + _stack(rest), *(k + _stack(each) for k, each in enumerate(operands)))
        case Binary(left=left, right=right):
            return max(_stack(left), 1 + _stack(right))
        case _:
            return max(map(_stack, children(node)), default=1)


# ---- facts and goals


def _owner(fact: FactNode, found: Diagnostics) -> Variable | None:
    owner = fact.owner
    if owner is not None and not isinstance(owner, Variable | Literal):
        found.report("E023", "the owner of a stated fact is a robot, or a variable for every robot", owner.span)
    return owner if isinstance(owner, Variable) else None


def _stated(fact: FactNode, found: Diagnostics) -> None:
    owner = _owner(fact, found)
    for argument in fact.arguments[1:]:
        own = isinstance(argument, Variable) and owner is not None and argument.name == owner.name != "_"
        if own or not _varies(argument):
            continue
        hint = None
        if isinstance(argument, Variable) and argument.name[0].isupper():
            constant = argument.name[0].lower() + argument.name[1:]
            hint = WordHint(f"a constant would be `{constant}`", constant)
        found.report("E023", "a fact that the program states has constant arguments", argument.span, hint=hint)


def _goal(fact: FactNode, found: Diagnostics) -> None:
    _owner(fact, found)
    for argument in fact.arguments[1:]:
        if not isinstance(argument, Variable) and _varies(argument):
            found.report("E023", "a goal's arguments are constants, or variables for anything", argument.span)


def _varies(argument: Expression) -> bool:
    """Whether an argument contains a variable or the time; constant ones without a value are reported by folding."""
    return any(
        isinstance(each, Variable) or (isinstance(each, Call) and each.name.text in TIMED) for each in walk(argument)
    )


# ---- effects


def _effects(item: TypeDeclaration, names: Names, found: Diagnostics) -> None:
    named: dict[str, Span] = {}
    for parameter in item.parameters:
        variable = parameter.variable
        if variable is None or variable.anonymous:
            continue
        if variable.name in named:
            notes = (DiagnosticNote(named[variable.name], "here"),)
            found.report("E031", f"`{variable.name}` names two arguments", variable.span, notes=notes)
        named[variable.name] = variable.span
    first = item.parameters[0].variable if item.parameters else None
    for effect in (*item.effects, *item.else_effects):
        for each in variables(effect):
            if each.name not in named:
                hint = "name the arguments: `type action moveto(R: robot, A: area) -o at(R, A).`"
                found.report("E030", f"no argument is called `{each.name}`", each.span, hint=hint)
        _no_anonymous(effect, found)
        owner = effect.owner
        own = isinstance(owner, Variable) and first is not None and owner.name == first.name
        if names.of(effect).kind is Kind.SENSED and owner is not None and not own:
            message = f"`{effect.name.text}` is sensed by its robot; only the executor's is an effect"
            found.report("E012", message, owner.span, notes=(DiagnosticNote(names.of(effect).place, "sensed"),))


def _no_anonymous(fact: FactNode, found: Diagnostics) -> None:
    for each in walk(fact):
        if isinstance(each, Variable) and each.anonymous:
            found.report("E030", "`_` has no value", each.span, hint="name what is derived")


# ---- functions


def _function(item: FunctionItem, found: Diagnostics) -> None:
    """Report what the definition of a function uses beside its parameters."""
    named: dict[str, Span] = {}
    for parameter in item.parameters:
        variable = parameter.variable
        if variable.name in named and not variable.anonymous:
            notes = (DiagnosticNote(named[variable.name], "here"),)
            found.report("E031", f"`{variable.name}` names two parameters", variable.span, notes=notes)
        named.setdefault(variable.name, variable.span)
    for each in walk(item.body):
        if isinstance(each, Variable) and (each.anonymous or each.name not in named):
            hint = "a function knows its parameters only"
            message = "`_` has no value" if each.anonymous else f"`{each.name}` is no parameter"
            found.report("E030", message, each.span, hint=hint)
    _no_now(item.body, found)


# ---- rules


def _untimed(rule: RuleItem, found: Diagnostics) -> None:
    """Report `now()` in bodies: no fact changes when time passes, so no rule would be matched again."""
    inner = [part.body for part in flat(rule.head) if isinstance(part, ComprehensionNode | AggregateNode)]
    for body in (rule.body, *inner):
        for conjunct in body:
            _no_now(conjunct.expression if isinstance(conjunct, Condition) else conjunct, found)


def _no_now(node: object, found: Diagnostics) -> None:
    for each in walk(node):
        if isinstance(each, Call) and each.name.text in TIMED | DRAWN:
            hint = "time alone satisfies no rule; a time assertion watches a deadline"
            if each.name.text in DRAWN:
                hint = "a match is looked for again and again: let the head derive what is drawn"
            found.report("E034", f"`{each.name.text}()` stands in heads only", each.span, hint=hint)


def _not_negative(deadline: Expression, found: Diagnostics) -> None:
    value = deadline.value if isinstance(deadline, Literal) else 0
    if isinstance(value, int | float) and value < 0:
        hint = "a deadline is the time that a job may take, in seconds after its start: `10`, `500ms`"
        found.report("E005", f"the deadline is negative: {value} s", deadline.span, hint=hint)


# ---- strategy


def _strategy(module: ModuleNode, found: Diagnostics) -> Strategy:
    stated = [item for item in module.items if isinstance(item, StrategyItem)]
    for item in stated:
        name = item.name.text
        if name not in STRATEGIES:
            hint = meant(name, list(STRATEGIES)) or "known are `random`, `textual` and `deadline`"
            found.report("E015", f"there is no order `{name}`", item.name.span, hint=hint)
    for item in stated[1:]:
        notes = (DiagnosticNote(stated[0].span, "first stated here"),)
        found.report("E010", "the order is stated twice", item.span, notes=notes)
    named = stated[0].name.text if stated else ""
    return Strategy[named.upper()] if named in STRATEGIES else Strategy.RANDOM
