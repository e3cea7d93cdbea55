"""Lint: warnings about legal programs that are probably mistakes. Warnings never stop compilation.

After a syntax error nothing is reported as missing: the broken item may contain it.
"""

from collections import Counter
from collections.abc import Iterator

from rmr.base.time import TICK_S
from rmr.base.values import Symbol
from rmr.bytecode import provided
from rmr.bytecode.program import Kind
from rmr.lang.analyse.fact_size import DELIVERY_OCTETS_MAX, FACT_OCTETS_MAX, octets
from rmr.lang.analyse.misspellings import Speller, lint_letters, lint_symbols
from rmr.lang.analyse.names import FactRole, Names, uses
from rmr.lang.analyse.nontermination import warn_endless
from rmr.lang.analyse.supply import Known, Supply
from rmr.lang.analyse.types import CALLABLE, WINNING, Types, constants, declaration_text, leaves
from rmr.lang.diagnostics.diagnostic import Diagnostics, WordHint
from rmr.lang.read.syntax import (
    AggregateNode,
    AssertionItem,
    Binary,
    ComprehensionNode,
    Condition,
    Conjunct,
    ConstantItem,
    Declared,
    Expression,
    FactItem,
    FactNode,
    FoldNode,
    FunctionItem,
    GoalItem,
    IncludeItem,
    Item,
    Literal,
    Mark,
    ModuleNode,
    RuleItem,
    StepsNode,
    StrategyItem,
    TypeDeclaration,
    Variable,
    flat,
    walk,
)

_SENT = {FactRole.HEAD, FactRole.EFFECT, FactRole.VIOLATION}
"""Roles of facts and actions that are sent by radio if their owner is another robot."""


NO_FIRING = "the rule cannot fire"


def warn(module: ModuleNode, names: Names, types: Types, found: Diagnostics) -> None:
    """Report the warnings about `module`."""
    _Lint(module, names, types, found).run()


class _Lint:
    def __init__(self, module: ModuleNode, names: Names, types: Types, found: Diagnostics) -> None:
        self._module = module
        self._names = names
        self._types = types
        self._found = found
        self._supply = Supply(module, names)
        self._speller = Speller(names, self._supply, found)
        self._reported: set[str] = set()
        self._symbols: dict[str, int] = {}
        """Number of uses by symbol."""
        self._letters: dict[str, Item | None] = {}
        """Symbols of one letter, each with the item that contains it, None if several do."""
        self._once: list[Variable] = []
        """Variables with one occurrence in their rule or time assertion."""
        for item in module.items:
            self._look_at(item)
        steps = [item for item in module.items if isinstance(item, TypeDeclaration) and item.kind is Declared.ACTION]
        self._events = {
            *[(item.name or item.finish.name).text for item in module.items if isinstance(item, AssertionItem)],
            *[item.name.text for item in steps if item.effects and item.name.text not in provided.ACTIONS],
        }

    def _look_at(self, item: Item) -> None:
        """Collect the symbols of an item, and the variables that a rule or a time assertion uses once."""
        variables: dict[str, Variable | None] = {}
        for node in walk(item):
            if isinstance(node, Variable):
                variables[node.name] = None if node.name in variables else node
            elif isinstance(node, Literal):
                for each in leaves(node.value):
                    if isinstance(each, Symbol):
                        self._count(each, item)
        if isinstance(item, RuleItem | AssertionItem):
            self._once += [each for each in variables.values() if each is not None and not each.anonymous]

    def _count(self, symbol: Symbol, item: Item) -> None:
        self._symbols[symbol] = self._symbols.get(symbol, 0) + 1
        if len(symbol) == 1:
            self._letters[symbol] = item if self._letters.get(symbol, item) is item else None

    def run(self) -> None:
        for variable in self._once:
            self._confusable(variable)
        for item in self._module.items:
            match item:
                case RuleItem():
                    for body, what in _bodies(item):
                        self._contradiction(body, what)
                    self._taken(item)
                    self._large(item, _home(item), constants(item.body))
                case TypeDeclaration():
                    executor = item.parameters[0].variable if item.parameters else None
                    self._large(item, executor, {})
                case AssertionItem():
                    self._short(item)
                    self._large(item, item.start.owner, {})
                case ConstantItem() | IncludeItem() | FactItem() | GoalItem() | StrategyItem() | FunctionItem():
                    pass
        self._speller.types(self._module)
        lint_letters(self._letters, self._types, self._found)
        lint_symbols(self._module, self._symbols, self._types, self._found)
        if not self._module.broken:
            self._absences()
            self._unstarted()
        warn_endless(self._module, self._names, self._found)

    def _absences(self) -> None:
        for item in self._module.items:
            match item:
                case RuleItem():
                    for body, what in _bodies(item):
                        for fact in body:
                            if isinstance(fact, FactNode) and not fact.absent and fact.mark is not Mark.GOAL:
                                self._never(fact, what)
                case GoalItem(fact=fact):
                    self._unreachable(fact, {})
                case AssertionItem():
                    self._never(item.start, "the assertion never starts a job")
                    self._unfinished(item.finish)
                case TypeDeclaration() | ConstantItem() | IncludeItem() | FactItem() | StrategyItem() | FunctionItem():
                    pass
            self._derivations(item)
        for fact, name in self._supply.circular():
            message = f"nothing can be the first to derive `{name}`, what derives it waits for it; {NO_FIRING}"
            hint = "state one to begin with"
            if self._names.of(fact).declaration is None:
                hint += f", or declare it if it comes from outside: `type {name}(...)`"
            hint += _without(fact)
            self._found.report("W102", message, fact.span, hint=hint)

    def _unstarted(self) -> None:
        """Report a program in which every rule waits for a fact from outside."""
        fact = self._supply.unstarted()
        if fact is None or self._found.failed or self._found.reported("W102"):
            return
        name = fact.name.text
        arity = len(fact.arguments)
        arguments = ", ".join(["R", *(["..."] if arity > 1 else [])])
        message = f"nothing states or derives `{name}`, and no rule can fire before there is one"
        hint = f"state one: `{name}({arguments}).`; from outside it comes by `rmr eval --insert` or a lab's `facts`"
        self._found.report("W115", message, fact.span, hint=hint)

    def _derivations(self, item: object) -> None:
        known = constants(item.body) if isinstance(item, RuleItem) else {}
        for use in uses(item) if isinstance(item, RuleItem) else ():
            if use.role is FactRole.HEAD and use.fact.mark is Mark.GOAL:
                self._unreachable(use.fact, known)
            elif use.role is FactRole.HEAD:
                self._speller.unread(use.fact)

    # ---- variables that may be constants

    def _confusable(self, variable: Variable) -> None:
        constant = variable.name[0].lower() + variable.name[1:]
        # A variable with a capital letter may be a misspelling of a reserved word, too.
        if (
            (constant in self._symbols or constant in ("true", "false"))
            and constant != variable.name
            and not self._found.wrong_at(variable.span)
        ):
            message = f"the variable `{variable.name}` is used only here and matches anything"
            self._found.report(
                "W101", message, variable.span, hint=WordHint(f"did you mean the constant `{constant}`?", constant)
            )

    # ---- rules that never fire

    def _contradiction(self, body: tuple[Conjunct, ...], what: str) -> None:
        values: dict[str, Literal] = {}
        for conjunct in body:
            if not isinstance(conjunct, Condition):
                continue
            match conjunct.expression:
                case Literal(value=False):
                    self._found.report("W102", f"this is never true, {what}", conjunct.span)
                case Binary("=", Variable(name=name), Literal() as value) | Binary(
                    "=", Literal() as value, Variable(name=name)
                ) if name != "_":
                    if values.setdefault(name, value).value != value.value:
                        self._found.report("W102", f"`{name}` cannot be both, {what}", conjunct.span)
                case _:
                    pass

    # ---- bodies that take what their heads look for

    def _taken(self, rule: RuleItem) -> None:
        """Report a fact that a body takes and nothing else uses, while the head is to find all facts of its kind."""
        counts = Counter(node.name for node in walk(rule) if isinstance(node, Variable))
        for part in flat(rule.head):
            if not isinstance(part, ComprehensionNode | AggregateNode):
                continue
            inner = {_kind_of(each) for each in part.body if isinstance(each, FactNode) and not each.absent}
            what = "aggregate" if isinstance(part, AggregateNode) else "comprehension"
            for fact in rule.body:
                if (
                    isinstance(fact, FactNode)
                    and fact.mark is Mark.NONE
                    and not fact.absent
                    and _kind_of(fact) in inner
                    and self._names.of(fact).kind is Kind.TEMPORARY
                    and len(fact.arguments) > 1
                    and all(isinstance(each, Variable) and _is_any(each, counts) for each in fact.arguments[1:])
                ):
                    message = f"the body uses up one `{fact.name.text}` that the {what} then does not find"
                    hint = f"`${fact.name.text}(...)` keeps it, and the {what} finds all"
                    self._found.report("W117", message, fact.span, hint=hint)

    def _never(self, fact: FactNode, what: str) -> None:
        name = fact.name.text
        signature = self._names.of(fact)
        if signature.provided:
            known = provided.PREDICATES.get(name)
            unsensed = known is not None and not known.sensed and signature.declaration is None
            if unsensed and not self._supply.inserted(name):
                hint = f"declare it if something does: `{declaration_text(name, signature.types, 'sensor ')}`"
                self._found.report("W102", f"no robot senses `{name}`, {what}", fact.span, hint=hint)
            else:
                self._unknown_event(fact, what)
        elif not self._supply.comes(name) and name not in self._reported:
            self._reported.add(name)
            declared = signature.declaration is not None
            meant = f"the run is given none either: state one{_without(fact)}" if declared else self._missing(fact)
            self._found.report("W102", f"nothing states or derives `{name}`, {what}", fact.span, hint=meant)

    def _unknown_event(self, fact: FactNode, what: str) -> None:
        kinds = self._names.of(fact).types
        for argument, kind in zip(fact.arguments[1:], kinds, strict=False):
            if kind.name != provided.EVENT or not isinstance(argument, Literal):
                continue
            if isinstance(argument.value, Symbol) and argument.value not in self._events:
                message = f"no time assertion is called `{argument.value}`, {what}"
                hint = self._speller.meant(argument.value, sorted(self._events))
                self._found.report("W102", message, argument.span, hint=hint)

    # ---- facts that nobody derives

    def _unreachable(self, goal: FactNode, known: Known) -> None:
        if not self._supply.may_match(goal, known) and not self._is_misspelt(goal):
            message = f"nothing in the program derives a fact that matches `?{goal.name.text}(...)`"
            self._found.report("W103", message, goal.span, hint=self._missing(goal))

    def _unfinished(self, finish: FactNode) -> None:
        if not self._supply.may_match(finish, {}) and not self._is_misspelt(finish):
            message = f"nothing in the program derives a fact that matches `{finish.name.text}(...)`"
            message += "; jobs are late unless one comes from outside"
            self._found.report("W104", message, finish.span, hint=self._missing(finish))

    def _is_misspelt(self, fact: FactNode) -> bool:
        """Whether an argument has been reported as misspelt."""
        return any(self._found.reported_at("W112", argument.span) for argument in fact.arguments)

    def _missing(self, fact: FactNode) -> str | None:
        """Return the hint for a fact that nothing derives."""
        name = fact.name.text
        if self._names.of(fact).declaration is not None or self._supply.is_derived(name):
            return None
        if name in CALLABLE:
            return f"a call alone is a fact; the function stands in parentheses: `({name}(...))`"
        known = self._speller.known(fact)
        return known or f"declare it if it comes from outside: `type {name}(...)`{_without(fact)}"

    # ---- sizes and times

    def _large(self, item: RuleItem | TypeDeclaration | AssertionItem, home: Expression | None, known: Known) -> None:
        for use in uses(item):
            fact = use.fact
            if use.role not in _SENT or not _is_away(fact.owner, home):
                continue
            kinds = self._types.arguments(fact.name.text)
            arguments = list(zip(fact.arguments[1:], kinds, strict=False))
            size = sum(octets(argument, kind, known) for argument, kind in arguments)
            if size <= FACT_OCTETS_MAX:
                continue
            # Two bounds: what may need fragments is a warning, what never fits a delivery an error.
            least = sum(octets(argument, kind, known, min) for argument, kind in arguments)
            if least > DELIVERY_OCTETS_MAX:
                message = f"the values of this fact take {least} octets, a delivery carries {DELIVERY_OCTETS_MAX}"
                hint = "it could never be sent; send it in parts, or something shorter that stands for it"
                self._found.report("E008", message, fact.span, hint=hint)
            else:
                message = f"the values of this fact take {size} octets, a radio frame has room for {FACT_OCTETS_MAX}"
                self._found.report("W105", message, fact.span, hint="it will be sent in fragments")

    def _short(self, item: AssertionItem) -> None:
        value = item.deadline.value if isinstance(item.deadline, Literal) else None
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < TICK_S:
            hint = "a robot decides 60 times a second; `500ms` and `2s` are times"
            self._found.report("W106", "this deadline is shorter than a tick", item.deadline.span, hint=hint)


def _bodies(rule: RuleItem) -> Iterator[tuple[tuple[Conjunct, ...], str]]:
    """Yield a rule's bodies, each with the consequence for a message if nothing matches it."""
    yield rule.body, NO_FIRING
    for each in rule.body:
        if isinstance(each, FoldNode) and each.operator.text in WINNING:
            yield each.body, NO_FIRING
    for part in flat(rule.head):
        match part:
            case ComprehensionNode(body=body):
                yield body, "the comprehension derives nothing"
            case AggregateNode(body=body):
                yield body, "the aggregate finds nothing"
            case FactNode() | StepsNode():
                pass


def _without(fact: FactNode) -> str:
    """Return the end of a hint at a persistent fact that nothing derives: `!` may be meant as `not`."""
    return f"; that there is none is `not {fact.name.text}(...)`" if fact.mark is Mark.BANG else ""


def _kind_of(fact: FactNode) -> tuple[str, str | None]:
    """Return the predicate of a fact, and the variable of its owner."""
    return fact.name.text, fact.owner.name if isinstance(fact.owner, Variable) else None


def _is_any(variable: Variable, counts: Counter[str]) -> bool:
    return variable.anonymous or counts[variable.name] == 1


def _home(rule: RuleItem) -> Expression | None:
    return next((each.owner for each in rule.body if isinstance(each, FactNode) and not each.absent), None)


def _is_away(owner: Expression | None, home: Expression | None) -> bool:
    """Whether a fact may belong to another robot than the home robot: their expressions differ."""

    match owner, home:
        case Variable(name=one), Variable(name=other):
            return one != other
        case Literal(value=this), Literal(value=that):
            return this != that
        case Literal() | Variable(), Literal() | Variable():
            return True
        case _:
            return False
