"""The intermediate form of generated code: its writer, its builder, and the passes that work on it."""

import ast
from functools import partial

import pytest

from rmr.base.streams import Choices
from rmr.lang.compiler import compile_source
from rmr.vm.engines import Engine, new_machine
from rmr.vm.generate.builder import FormBuilder
from rmr.vm.generate.form import (
    Assign,
    AssignAll,
    Break,
    Continue,
    Define,
    Delete,
    Evaluate,
    If,
    Loop,
    Raise,
    Return,
    Statement,
    Try,
    Update,
    While,
    Yield,
    text_of,
    with_otherwise,
)
from rmr.vm.generated import machine_of

A, B, C = Evaluate("a()"), Evaluate("b()"), Evaluate("c()")


@pytest.mark.parametrize(
    ("statement", "text"),
    [
        (Assign("x", "1"), "x = 1"),
        (AssignAll(("x", "y"), "1"), "x = y = 1"),
        (Update("x", "|", "1"), "x |= 1"),
        (Delete("x[0]"), "del x[0]"),
        (Yield("x"), "yield x"),
        (Return(), "return"),
        (Return("x"), "return x"),
        (Raise("x"), "raise x"),
        (If("x", (A,)), "if x:\n a()"),
        (If("x", ()), "if x:\n pass"),
        (If("x", (A,), (B,)), "if x:\n a()\nelse:\n b()"),
        (If("x", (A,), (If("y", (B,), (C,)),)), "if x:\n a()\nelif y:\n b()\nelse:\n c()"),
        (If("x", (A,), (If("y", (B,)), C)), "if x:\n a()\nelse:\n if y:\n  b()\n c()"),
        (Loop("x", "y", (Continue(),), (A,)), "for x in y:\n continue\nelse:\n a()"),
        (While("x", (Break(),), (A,)), "while x:\n break\nelse:\n a()"),
        (Try("E", "", (A,), (B,)), "try:\n b()\nexcept E:\n a()"),
        (Try("E", "e", (A,), (B,)), "try:\n b()\nexcept E as e:\n a()"),
        (Define("f", ("x", "y"), (A,)), "def f(x, y):\n a()"),
    ],
)
def test_writer_prints_each_statement(statement: Statement, text: str) -> None:
    assert text_of([statement]) == text + "\n"


def test_builder_nests_open_blocks_until_the_level_ends() -> None:
    build = FormBuilder()
    with build.function("f"):
        mark = build.mark()
        with build.level():
            build.open(partial(Loop, "x", "y"))
            build.open(partial(If, "x"))
            build(A)
        build(B)
        build.insert(mark, [C])
    nested = Loop("x", "y", (If("x", (A,)),))
    assert build.statements == (Define("f", (), (C, nested, B)),)


def test_else_branch_belongs_to_the_last_elif() -> None:
    build = FormBuilder()
    build(If("x", (A,), (If("y", (B,)),)))
    with build.otherwise():
        build(C)
    assert build.statements == (If("x", (A,), (If("y", (B,), (C,)),)),)
    assert with_otherwise(While("x", (A,)), (B,)) == While("x", (A,), (B,))


LISTS = """
type n(robot, list int).
type g(robot, int).
n(R, L), len(L) > 0, nth(L, 0) = 1 -o g(R, 1).
n(R, L), len(L) > 0, nth(L, 0) = 2 -o g(R, 2).
n(R, L), len(L) > 0, nth(L, 0) = 3 -o g(R, 3).
"""
REMAINDERS = """
type n(robot, int, int).
type g(robot, int).
n(R, X, Y), Y > 0, X % Y = 1 -o g(R, 1).
n(R, X, Y), Y > 0, X % Y = 2 -o g(R, 2).
n(R, X, Y), Y > 0, X % Y = 3 -o g(R, 3).
"""


@pytest.mark.parametrize("engine", list(Engine))
@pytest.mark.parametrize(
    ("text", "args", "left"),
    [
        (LISTS, ((),), ["n(@1, [])"]),
        (LISTS, ((2, 1),), ["g(@1, 2)"]),
        (REMAINDERS, (5, 0), ["n(@1, 5, 0)"]),
        (REMAINDERS, (7, 4), ["g(@1, 3)"]),
    ],
)
def test_equality_test_is_not_hoisted_above_the_condition_that_it_needs(engine, text, args, left) -> None:
    program = compile_source(text).program
    assert program is not None
    machine = new_machine(program, 1, Choices("any"), engine=engine)
    machine.start(0)
    names = [each.name for each in program.predicates]
    machine.insert(0, names.index("n"), args)
    machine.run(0)
    assert machine.facts() == left


def test_equality_tests_of_one_argument_become_one_choice() -> None:
    rules = "".join(f"n(R, X), X % 4 = {rest} -o g(R, {rest}). " for rest in (1, 2, 3))
    program = compile_source(f"type n(robot, int). type g(robot, int). {rules}").program
    assert program is not None
    module = machine_of(program).module
    module.change([each.name for each in program.predicates].index("n"))
    tree = ast.parse("\n".join(module.sources))
    add = next(each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.name == "add0")
    tests = [ast.unparse(each.test) for each in ast.walk(add) if isinstance(each, ast.If)]
    assert [each for each in tests if each.startswith("c ==")] == ["c == 1", "c == 2", "c == 3"]
