"""Programs that qualify for columns, drawn from a seed, and what one robot of them looks like at any moment."""

from random import Random

from rmr.analysis.column_obstacles import obstacles
from rmr.base.streams import Choices
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source
from rmr.vm.engines import Engine, new_machine
from rmr.vm.machine import Machine

DECLARED = """
type t0(robot). type t1(robot, int). type t2(robot, int, mark). type t3(robot, robot).
type n(robot, int). type f(robot, float). type !id(robot, int).
type b(robot, bool). type w(robot, int). type x(robot, float).
type !d(robot). type !e(robot, mark). type !l(robot, int).
"""
TOKENS = {"t0": [], "t1": ["int"], "t2": ["int", "mark"], "t3": ["robot"]}
"""One of these holds, never two: the predicates with the types of their arguments."""
ARGUMENTS = TOKENS | {"n": ["int"], "f": ["float"], "b": ["bool"], "w": ["int"]}
ARGUMENTS |= {"d": [], "e": ["mark"], "l": ["int"], "id": ["int"]}
GOALS = ["t0(R)", "t1(R, _)", "t1(R, 1)", "t2(R, _, red)", "t3(R, R)", "n(R, 3)", "x(R, _)", "d(R)"]
INTS = ["0", "1", "2", "3", "7", "-1", "9223372036854775807", "4611686018427387905", "9007199254740993"]
FLOATS = ["0.0", "-0.0", "0.5", "2.0", "1e308", "9007199254740992.0", "-3.25"]
MARKS = ["red", "green", "blue"]
ROBOTS = ["@0", "@1", "@7"]


class Drawn:
    """A program in the making."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.variables: dict[str, str] = {}
        """By name the type, of the rule in the making."""
        self.passed: list[str] = []
        """Where the token can be."""

    def text(self) -> str:
        """A program: what is stated, goals, rules."""
        rng = self.rng
        self.passed = [rng.choice(list(TOKENS))]
        lines = [DECLARED, self.fact(self.passed[0])]
        lines += [f"{name}(R, {self.constant(kind)})." for name, kind in (("n", "int"), ("f", "float"), ("b", "bool"))]
        lines += [rng.choice(["!d(R).", ""]), rng.choice([f"!l(@1, {self.constant('int')}).", ""])]
        for _each in range(rng.choice([0, 0, 1, 2, 3])):
            lines.append(f"?{self.goal()}.")
        lines += [self.rule() for _each in range(rng.randint(3, 8))]
        lines += [rng.choice(["order textual.", ""])]
        return "\n".join(lines)

    def goal(self) -> str:
        name = self.rng.choice(
            ["t0(R)", "t1(R, _)", "t1(R, 1)", "t2(R, _, red)", "t3(R, R)", "n(R, 3)", "x(R, _)", "d(R)"]
        )
        return name if self.rng.random() < 0.8 else name.replace("(R", "(@1", 1)

    def fact(self, name: str) -> str:
        return f"{name}({', '.join(['R', *map(self.constant, TOKENS[name])])})."

    def constant(self, kind: str) -> str:
        if kind == "robot":
            return self.rng.choice([*ROBOTS, "R"])
        pool = {"int": INTS, "float": FLOATS, "mark": MARKS, "bool": ["true", "false"]}[kind]
        return self.rng.choice(pool[:6] if self.rng.random() < 0.8 else pool)

    # ---- rules

    def rule(self) -> str:
        rng = self.rng
        self.variables = {"R": "robot"}
        body: list[str] = []
        head: list[str] = []
        if rng.random() < 0.75:
            body.append(self.atom(rng.choice(self.passed)))
            head.append(rng.choice(list(TOKENS)))
            self.passed.append(head[-1])
        elif rng.random() < 0.7:
            body.append("$" + self.atom(rng.choice(list(TOKENS))))
        for name in ("n", "f", "b", "w"):
            chance = rng.random()
            if chance < 0.2 and (name != "w" or chance < 0.05):
                body.append(self.atom(name))
                head.append(name)
            elif chance < 0.28 and name != "w":
                body.append("$" + self.atom(name))
        body += [self.atom(name) for name in ("d", "e", "l", "id") if rng.random() < (0.15 if name == "id" else 0.05)]
        body += [f"not {self.absent()}"] if rng.random() < 0.15 else []
        rng.shuffle(body)
        if rng.random() < 0.2:
            body.append(f"V = {self.expression(kind := rng.choice(['int', 'float']), 2)}")
            self.variables["V"] = kind
        for _each in range(rng.choice([0, 0, 0, 0, 1, 2])):
            body.insert(rng.randint(0, len(body)), self.condition(2))
        if "w" not in head and rng.random() < 0.2 and not any("w(" in each for each in body):
            body.append("not w(R, _)")
            head.append("w")
        if rng.random() < 0.2:
            head.append(rng.choice(["!d(R)", "!e(R, red)"]))
        rng.shuffle(head)
        said = ", ".join([each if "(" in each else self.derived(each) for each in head] or ["1"])
        return f"{', '.join(body) or 'd(R)'} -o {said}."

    def atom(self, name: str) -> str:
        return f"{name}({', '.join(['R', *[self.pattern(kind) for kind in ARGUMENTS[name]]])})"

    def pattern(self, kind: str) -> str:
        """An argument in a body: mostly a new variable, else one that is bound, a constant or nothing."""
        chance = self.rng.random()
        known = [name for name, other in self.variables.items() if other == kind]
        if chance < 0.05 and known:
            return self.rng.choice(known)
        if chance < 0.15:
            return self.constant(kind)
        if chance < 0.25:
            return "_"
        name = f"X{len(self.variables)}"
        self.variables[name] = kind
        return name

    def absent(self) -> str:
        name = self.rng.choice(["t0", "t1", "n", "w", "d", "e"])
        args = ["R", *[self.rng.choice(["_", self.constant(kind)]) for kind in ARGUMENTS[name]]]
        return f"{name}({', '.join(args)})"

    def derived(self, name: str) -> str:
        return f"{name}({', '.join(['R', *[self.expression(kind, 2) for kind in ARGUMENTS[name]]])})"

    def condition(self, depth: int) -> str:
        one, other = (self.expression(self.rng.choice(["int", "float"]), depth) for _each in range(2))
        return f"{one} {self.rng.choice(['<', '<=', '>', '>=', '!='])} {other}"

    def expression(self, kind: str, depth: int) -> str:
        rng = self.rng
        known = [name for name, other in self.variables.items() if other == kind]
        if depth == 0 or rng.random() < 0.35 or kind in ("mark", "robot"):
            return rng.choice(known) if known and rng.random() < 0.7 else self.constant(kind)
        if rng.random() < 0.15:
            condition, one, other = self.truth(depth - 1), *(self.expression(kind, depth - 1) for _each in range(2))
            return f"if({condition}, {one}, {other})"
        if kind == "bool":
            return f"({self.truth(depth)})"
        one, other = self.expression(kind, depth - 1), self.expression(kind, depth - 1)
        if kind == "float":
            mixed = self.expression("int", depth - 1)
            forms = [f"({one} + {mixed})", f"({mixed} - {other})", f"({one} * {other})", f"({one} / {mixed})"]
            forms += [f"({mixed} / {self.expression('int', 0)})", f"({one} % {other})", f"sqrt({one})", f"sin({one})"]
            forms += [f"min({one}, {mixed})", f"abs({one})", f"dist({one}, {other}, {mixed}, 0)", f"(-{one})"]
            return rng.choice(forms)
        forms = [f"({one} {op} {other})" for op in "+-*%"] + [f"min({one}, {other})", f"max({one}, {other})"]
        forms += [f"abs({one})", f"(-{one})", f"floor({self.expression('float', depth - 1)})", "id(R)"]
        return rng.choice(forms)

    def truth(self, depth: int) -> str:
        if depth and self.rng.random() < 0.4:
            return f"(({self.truth(depth - 1)}) {self.rng.choice(['&&', '||'])} ({self.truth(depth - 1)}))"
        if self.rng.random() < 0.3:
            return f"(not {self.condition(max(0, depth - 1))})"
        return self.condition(max(0, depth - 1))


def qualifying(seed: int) -> tuple[str, Program] | None:
    """Return a drawn program with its text, or None if it is none or does not qualify."""
    text = Drawn(seed).text()
    program = compile_source(text, "p.rmr").program
    return None if program is None or obstacles(program) else (text, program)


class Alone:
    """One robot by itself, as a machine."""

    def __init__(
        self, program: Program, robot: int, name: str, budget: int, engine: Engine = Engine.INTERPRETER
    ) -> None:
        self.choices = Choices(name)
        self.machine: Machine = new_machine(program, robot, self.choices, engine=engine, firing_budget=budget)
        self.machine.start(0)

    def run(self, times: int = 1) -> None:
        """So many runs within the budget; what happened is nobody's concern."""
        for _each in range(times):
            if not self.machine.quiescent:
                self.machine.run(0)
        self.machine.drain()

    @property
    def state(self) -> dict[str, object]:
        """What can be seen of it."""
        machine = self.machine
        return {
            "facts": machine.facts(),
            "goals": machine.goals(),
            "firings": machine.firings,
            "stream": self.choices.state,
            "failures": machine.expression_failures,
            "busy": not machine.quiescent,
        }
