"""Code generation: checked and projected items to the program that the codec writes.

The input has no errors, so nothing fails here. An int in the place of a float is converted: a constant at compile
time, an expression by an instruction at run time.
"""

from collections import Counter
from collections.abc import Sequence
from operator import attrgetter

from rmr.base.values import Robot, Value
from rmr.bytecode import program as form
from rmr.bytecode import provided
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import ANY, SELF_SLOT, Base, Code, Instruction, Kind, Mode, OwnFunction, Slot, Type
from rmr.lang.analyse.folding import INSTRUCTIONS
from rmr.lang.analyse.let_lifting import plain_name
from rmr.lang.analyse.names import FactRole, Names, Signature, Use, declared_type
from rmr.lang.analyse.types import Types, converted
from rmr.lang.lower.ensemble_writer import Made
from rmr.lang.lower.projection import OPERATORS
from rmr.lang.lower.robot_rules import (
    SELF,
    Decide,
    Derived,
    Environment,
    Gather,
    Let,
    MatchStep,
    Projected,
    RobotAggregate,
    RobotComprehension,
    RobotValue,
    RobotWhen,
    Step,
)
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    AssertionItem,
    Binary,
    Call,
    Expression,
    FactItem,
    FactNode,
    GoalItem,
    LetTerm,
    ListTerm,
    Literal,
    Mark,
    StepsNode,
    TypeDeclaration,
    TypeName,
    Unary,
    Variable,
)

_FUNCTIONS = {function.name: index for index, function in enumerate(FUNCTIONS)}


class Emitter:
    """Emits the parts of one program."""

    def __init__(self, names: Names, types: Types) -> None:
        self._names = names
        self._types = types
        self._index = {name: index for index, name in enumerate(names.signatures)}
        self._own = {
            name: (index, OwnFunction(plain_name(name), len(item.parameters)))
            for index, (name, item) in enumerate(names.functions.items())
        }
        goals = [use.fact.name.text for use in names.uses if _is_goal_table(use)]
        self._goals = {name: len(self._index) + place for place, name in enumerate(dict.fromkeys(goals))}
        """The predicates that stand for the open goals of others, by the names of these."""

    def _types_of(self, fact: FactNode) -> tuple[Type, ...]:
        return self._types.arguments(fact.name.text)

    def _at(self, fact: FactNode) -> int:
        return self._index[fact.name.text]

    # ---- functions

    def functions(self) -> tuple[OwnFunction, ...]:
        """Return the program's functions, with their code."""
        for name, item in self._names.functions.items():
            _, function = self._own[name]
            parameters = [parameter.variable.name for parameter in item.parameters]
            environment = Environment({each: place for place, each in enumerate(parameters)}, count=len(parameters))
            function.code = self._given(item.body, item.result, environment)
        return tuple(function for _, function in self._own.values())

    def _given(self, expression: Expression, wanted: TypeName | None, environment: Environment) -> Code:
        """Return the code of an expression whose value has a declared type, or any."""
        code = self._code(expression, environment)
        is_float = wanted is not None and _innermost(declared_type(wanted)).base is Base.FLOAT
        return (*code, Instruction(Op.FLOAT)) if is_float and not self._types.certainly_float(expression) else code

    # ---- predicates

    @property
    def places(self) -> tuple[Span, ...]:
        """The places of the predicates; goals have that of their predicate."""
        signatures = self._names.signatures
        return (*[each.place for each in signatures.values()], *[signatures[name].place for name in self._goals])

    def predicates(self) -> tuple[form.Predicate, ...]:
        """Return the table of predicates and actions."""
        declared = [self._predicate(signature) for signature in self._names.signatures.values()]
        goals = [form.Predicate(form.GOALS_OF + name, Kind.SENSED, self._types.arguments(name)) for name in self._goals]
        return (*declared, *goals)

    def hidden(self, made: Sequence[Made]) -> tuple[form.HiddenPredicate, ...]:
        """Return the table of the predicates that ensemble rules have brought."""
        index = self._index
        table = [
            form.HiddenPredicate(index[each.name], each.duty, None if each.other is None else index[each.other])
            for each in made
        ]
        return tuple(sorted(table, key=attrgetter("predicate")))

    def _predicate(self, signature: Signature) -> form.Predicate:
        types = self._types.arguments(signature.name)
        declaration = signature.declaration
        effects: tuple[form.Effect, ...] = ()
        otherwise: tuple[form.Effect, ...] = ()
        if declaration is not None and signature.kind is Kind.ACTION:
            environment = effect_environment(declaration)
            effects = tuple(self._effect(fact, environment) for fact in declaration.effects)
            otherwise = tuple(self._effect(fact, environment) for fact in declaration.else_effects)
            action = provided.ACTIONS.get(signature.name)
            if not effects and action is not None and action.effect is not None:
                effects = self._default_effect(action.effect, types)
        unordered = declaration is not None and declaration.unordered is not None
        return form.Predicate(
            signature.name, signature.kind, types, signature.provided, effects, otherwise, signature.best, unordered
        )

    def _effect(self, fact: FactNode, environment: Environment) -> form.Effect:
        owner = self._code(fact.arguments[0], environment)
        return form.Effect(self._at(fact), self._arguments(fact, environment), owner)

    def _default_effect(self, predicate: str, types: tuple[Type, ...]) -> tuple[form.Effect, ...]:
        """Return the default effect of a provided action, if the program uses `predicate` as a fact of one symbol."""
        known = self._names.signatures.get(predicate)
        if known is None or known.kind is Kind.ACTION or known.arity != 2 or len(types) != 1:
            return ()
        if self._types.arguments(predicate)[0].base not in {Base.SYMBOL, Base.OPEN}:
            return ()
        # Slot 1 is the action's one argument: `moveto(R, A)` ends with `location(R, A)`.
        return (form.Effect(self._index[predicate], ((Instruction(Op.LOAD, 1),),)),)

    # ---- initial facts and goals

    def fact(self, item: FactItem) -> form.InitialFact:
        """Return an initial fact; a variable among its arguments is the owner, the only one in scope."""
        arguments = zip(item.fact.arguments[1:], self._types_of(item.fact), strict=True)
        values = tuple(
            Slot(SELF_SLOT) if isinstance(argument, Variable) else converted(_value(argument), kind)
            for argument, kind in arguments
        )
        return form.InitialFact(self._at(item.fact), _owner(item.fact), values)

    def goal(self, item: GoalItem) -> form.InitialGoal:
        """Return an initial goal; a variable with one occurrence is a wildcard."""
        owner, *others = item.fact.arguments
        counts = Counter(each.name for each in others if isinstance(each, Variable) and not each.anonymous)
        environment = Environment()
        if isinstance(owner, Variable) and not owner.anonymous:
            environment.slots[owner.name] = SELF_SLOT
        patterns: list[form.Pattern] = []
        for argument, kind in zip(others, self._types_of(item.fact), strict=True):
            if not isinstance(argument, Variable):
                patterns.append(form.Constant(converted(_value(argument), kind)))
            elif argument.name in environment.slots or counts[argument.name] > 1:  # a join within the goal
                patterns.append(Slot(environment.slot(argument.name)))
            else:
                patterns.append(ANY)
        return form.InitialGoal(self._at(item.fact), _owner(item.fact), tuple(patterns))

    # ---- rules

    def rule(self, projected: Projected) -> form.Rule:
        """Return the code of a projected rule."""
        environment = projected.environment
        # Body, then head: both may take slots, and `count` is read last, when all are taken.
        body = self._steps(projected.body, environment)
        head = tuple(self._head(part, environment) for part in projected.head)
        return form.Rule(environment.count, body, head)

    def _step(self, step: Step, environment: Environment) -> form.Conjunct:
        match step:
            case MatchStep(fact=fact, arguments=arguments, mode=mode):
                return self.atom(fact, arguments, mode, environment)
            case Let(name=name, expression=expression):
                return form.Bind(environment.slots[name], self._code(expression, environment))
            case Decide(expression=expression):
                return form.Guard(self._code(expression, environment))
            case Gather(node=node, environment=inner):
                return form.Fold(
                    operator=OPERATORS[node.operator.text],
                    term=None if node.term is None else self._code(node.term, inner),
                    result=step.result,
                    slots=step.slots,
                    body=self._steps(step.body, inner),
                )

    def _steps(self, steps: tuple[Step, ...], environment: Environment) -> tuple[form.Conjunct, ...]:
        return tuple(self._step(step, environment) for step in steps)

    def _head(self, part: Derived, environment: Environment) -> form.Head:
        match part:
            case RobotValue(slot=slot, expression=expression):
                return form.HeadValue(slot, self._code(expression, environment))
            case RobotWhen(slot=slot, item=item):
                inner = self._head(item, environment)
                assert not isinstance(inner, form.HeadValue | form.When)
                return form.When(slot, inner)
            case FactNode():
                return self.derived(part, environment)
            case StepsNode(derived=derived):
                return form.Steps(tuple(self.derived(fact, environment) for fact in derived))
            case RobotComprehension(slots=slots, body=steps, head=facts, environment=inner):
                head = tuple(self.derived(fact, inner) for fact in facts)
                return form.Comprehension(slots, self._steps(steps, inner), head)
            case RobotAggregate():
                return self._aggregate(part)

    def _aggregate(self, part: RobotAggregate) -> form.Aggregate:
        item = part.item
        inner = part.environment
        return form.Aggregate(
            operator=OPERATORS[item.operator.text],
            term=None if item.term is None else self._code(item.term, inner),
            result=part.result,
            slots=part.slots,
            body=self._steps(part.body, inner),
            head=tuple(self.derived(fact, part.head_environment) for fact in item.head),
        )

    def atom(
        self, fact: FactNode, arguments: tuple[Variable | Literal, ...], mode: Mode, environment: Environment
    ) -> form.Atom:
        """Return the pattern of a fact in a body or a time assertion."""
        kinds = self._types_of(fact)
        patterns = (self._pattern(each, kind, environment) for each, kind in zip(arguments, kinds, strict=True))
        predicate = self._goals[fact.name.text] if fact.mark is Mark.GOAL else self._at(fact)
        return form.Atom(predicate, tuple(patterns), mode)

    @staticmethod
    def _pattern(argument: Variable | Literal, kind: Type, environment: Environment) -> form.Pattern:
        if isinstance(argument, Literal):
            return form.Constant(converted(argument.value, kind))
        if argument.anonymous:
            return ANY
        constant = environment.constants.get(argument.name)
        if constant is not None:
            return form.Constant(converted(constant.value, kind))
        return Slot(environment.slots[argument.name])

    def derived(self, fact: FactNode, environment: Environment) -> form.Derived:
        """Return the fact, goal or action that one item of a head derives."""
        predicate = self._at(fact)
        owner = self._code(fact.arguments[0], environment)
        arguments = self._arguments(fact, environment)
        if self._names.of(fact).kind is Kind.ACTION:
            return form.DeriveAction(predicate, owner, arguments)
        if fact.mark is Mark.GOAL:
            return form.DeriveGoal(self._goals[fact.name.text] if fact.absent else predicate, owner, arguments)
        return form.DeriveFact(predicate, owner, arguments)

    def _arguments(self, fact: FactNode, environment: Environment) -> tuple[Code, ...]:
        arguments = zip(fact.arguments[1:], self._types_of(fact), strict=True)
        return tuple(self._argument(argument, kind, environment) for argument, kind in arguments)

    def _argument(self, argument: Expression, kind: Type, environment: Environment) -> Code:
        if isinstance(argument, Variable) and argument.name in environment.constants:
            argument = environment.constants[argument.name]
        if isinstance(argument, Literal):
            return (_constant(converted(argument.value, kind)),)
        code = self._code(argument, environment)
        # An int may reach a float argument: unless the type excludes that, the value is converted when derived.
        if _innermost(kind).base is Base.FLOAT and not self._types.certainly_float(argument):
            return (*code, Instruction(Op.FLOAT))
        return code

    # ---- time assertions

    def assertion(
        self, item: AssertionItem, environment: Environment, finish: tuple[Variable | Literal, ...]
    ) -> form.Assertion:
        """Return a time assertion without `serving`, which is computed on the finished program."""
        start = tuple(each for each in item.start.arguments[1:] if isinstance(each, Variable | Literal))
        violation = self.derived(item.violation, environment)
        assert isinstance(violation, form.DeriveAction | form.DeriveFact)
        return form.Assertion(
            name=item.name.text if item.name is not None else item.finish.name.text,
            slots=environment.count,
            start=self.atom(item.start, start, self._watching(item.start), environment),
            finish=self.atom(item.finish, finish, self._watching(item.finish), environment),
            deadline=self._code(item.deadline, environment),
            violation=violation,
            scheduled=item.scheduled,
            robot=_owner(item.start),
            finisher=_finisher(item, environment),
        )

    def _watching(self, fact: FactNode) -> Mode:
        return Mode.KEEP if self._names.of(fact).kind is Kind.TEMPORARY else Mode.READ

    # ---- expressions

    def _code(self, expression: Expression, environment: Environment) -> Code:
        match expression:
            case Literal(value=value):
                return (_constant(value),)
            case Variable(name=name):
                if name in environment.constants:
                    return (_constant(environment.constants[name].value),)
                return (Instruction(Op.LOAD, environment.slots[name]),)
            case Unary(operator=operator, operand=operand):
                return (*self._code(operand, environment), Instruction(Op.NOT if operator == "not" else Op.NEG))
            case Binary(operator=operator, left=left, right=right):
                one = self._code(left, environment)
                other = self._code(right, environment)
                # Short circuit: the left value stays on the stack if it decides, else it is popped and the right runs.
                if operator in {"&&", "||"}:
                    return (*one, Instruction(Op.AND if operator == "&&" else Op.OR, len(other)), *other)
                return (*one, *other, Instruction(INSTRUCTIONS[operator]))
            case Call():
                return self._call(expression, environment)
            case LetTerm():
                raise AssertionError("a let that was not lifted")
            case ListTerm(items=items, rest=rest):
                codes = [self._code(item, environment) for item in items]
                return _list(codes, () if rest is None else self._code(rest, environment))

    def _call(self, call: Call, environment: Environment) -> Code:
        if call.name.text in self._own:
            return self._applied(call, environment)
        codes = [self._code(argument, environment) for argument in call.arguments]
        name = call.name.text
        if name != "if":
            return (*(each for code in codes for each in code), Instruction(Op.CALL, _FUNCTIONS[name]))
        condition, then, otherwise = codes
        # The false branch skips `then` and the jump behind it: one instruction more than `then` has.
        return (
            *condition,
            Instruction(Op.JUMP_IF_FALSE, len(then) + 1),
            *then,
            Instruction(Op.JUMP, len(otherwise)),
            *otherwise,
        )

    def _applied(self, call: Call, environment: Environment) -> Code:
        """Return the code of a call of a function of the program."""
        index, function = self._own[call.name.text]
        parameters = self._names.functions[call.name.text].parameters
        given = zip(call.arguments, parameters, strict=True)
        codes = [self._given(argument, parameter.type, environment) for argument, parameter in given]
        return (*(each for code in codes for each in code), Instruction(Op.APPLY, index, function))


def _is_goal_table(use: Use) -> bool:
    """Return whether a rule reads goals, or withdraws one."""
    return use.fact.mark is Mark.GOAL and (use.role is FactRole.BODY or use.fact.absent)


def effect_environment(declaration: TypeDeclaration) -> Environment:
    """Return the environment of an action's effects: slot 0 is the executor, slots 1.. the arguments."""
    environment = Environment({SELF: SELF_SLOT})
    for index, parameter in enumerate(declaration.parameters):
        if parameter.variable is not None and not parameter.variable.anonymous:
            environment.slots[parameter.variable.name] = index
    environment.count = len(declaration.parameters)
    return environment


def place(span: Span, line_and_column: tuple[int, int]) -> form.Place:
    """Return the debug entry of a place in the source."""
    return form.Place(span.file, *line_and_column)


def _constant(value: Value) -> Instruction:
    # Exact type: robots and Booleans are subclasses of int, and go into the pool of constants.
    if type(value) is int:
        return Instruction(Op.INT, value)
    return Instruction(Op.CONST, value)


def _list(items: Sequence[Code], rest: Code) -> Code:
    """Return the code of a list of `items`, with `rest` appended unless it is empty."""
    made = (*(each for code in items for each in code), Instruction(Op.LIST, len(items)))
    return (*made, *rest, Instruction(Op.ADD)) if rest else made


def _innermost(kind: Type) -> Type:
    """Return the element type of nested lists at the innermost level; the type itself if it is no list."""
    while kind.element is not None:
        kind = kind.element
    return kind


def _owner(fact: FactNode) -> int | None:
    owner = fact.arguments[0]
    return int(owner.value) if isinstance(owner, Literal) and isinstance(owner.value, Robot) else None


def _finisher(item: AssertionItem, environment: Environment) -> Slot | form.Constant:
    """Return the owner of the finish fact, in terms of the robot that holds the job."""
    owner = item.finish.arguments[0]
    if isinstance(owner, Variable):
        return Slot(environment.slots[owner.name])
    home = _owner(item.start)
    return Slot(SELF_SLOT) if home is not None and home == _owner(item.finish) else form.Constant(_value(owner))


def _value(expression: Expression) -> Value:
    assert isinstance(expression, Literal), expression
    return expression.value
