"""The program that comes out: projection, order, conversions, code, and which actions serve an assertion."""

import pytest
from lang_source import CORRIDOR, compiled, errors

from rmr.base.values import Robot, Symbol
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    Atom,
    Bind,
    Comprehension,
    Constant,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Guard,
    Instruction,
    Kind,
    Mode,
    Operator,
    Serving,
    Slot,
    Steps,
    Strategy,
)

SELF = (Instruction(Op.LOAD, 0),)
LEN, NTH, REST = (
    next(index for index, function in enumerate(FUNCTIONS) if function.name == name) for name in ("len", "nth", "rest")
)


def rule(text):
    [only] = compiled(text).rules
    return only


def ops(code):
    return [(each.op.name, each.operand) for each in code]


def code_of(expression, declared="float"):
    """Return the code of an expression over X, an int."""
    head = rule(f"type p(robot, int). type q(robot, {declared}). p(R, X) -o q(R, {expression}).").head[0]
    return ops(head.args[0])


# ---- projection


def test_the_owner_disappears_and_is_slot_0():
    projected = rule("p(R, R, X) -o q(R, X, R).")
    assert projected.body == (Atom(0, (Slot(0), Slot(1)), Mode.CONSUME),)
    assert projected.head == (DeriveFact(1, SELF, ((Instruction(Op.LOAD, 1),), SELF)),)


def test_a_named_home_robot_becomes_a_condition():
    projected = rule("p(@3, X) -o q(@4, X).")
    assert isinstance(projected.body[0], Guard)
    assert projected.body[0].code == (*SELF, Instruction(Op.CONST, Robot(3)), Instruction(Op.EQ))
    assert projected.head[0].owner == (Instruction(Op.CONST, Robot(4)),)


def test_an_anonymous_owner_is_the_home_robot():
    assert rule("p(_, X) -o q(@1, X).").body == (Atom(0, (Slot(1),), Mode.CONSUME),)


def test_modes_follow_kinds():
    text = "type !e(robot). type sensor s(robot). p(R), e(R), s(R), $k(R), not n(R) -o 1."
    assert [each.mode.name for each in rule(text).body] == ["CONSUME", "ABSENT", "READ", "READ", "KEEP"]


def test_the_order_of_conjuncts_means_nothing():
    one = rule("p(R, X), Y = X + 1, Y < 9 -o q(R, Y).")
    other = rule("Y < 9, X + 1 = Y, p(R, X) -o q(R, Y).")
    assert [type(each) for each in one.body] == [Atom, Bind, Guard]
    assert [type(each) for each in other.body] == [Atom, Bind, Guard]
    assert one.head == other.head


def test_a_condition_stands_as_early_as_it_can_be_decided():
    body = rule("p(R, X), q(R, Y), X > 1, Y > X -o 1.").body
    assert [type(each) for each in body] == [Atom, Guard, Atom, Guard]


def test_a_variable_equal_to_a_constant_is_replaced_by_it():
    projected = rule("location(R, L), L = s -o location(R, middle), was(R, L).")
    assert projected.body == (Atom(0, (Constant(Symbol("s")),), Mode.CONSUME),)
    assert projected.head[1].args == ((Instruction(Op.CONST, Symbol("s")),),)
    assert projected.slots == 1


def test_a_constant_that_a_place_cannot_hold_stays_a_condition():
    body = rule("type p(robot, int). p(R, X), X = 2.5 -o 1.").body
    assert body[0].args == (Slot(1),)
    assert ops(body[1].code) == [("LOAD", 1), ("CONST", 2.5), ("EQ", None)]


def test_a_variable_that_no_fact_binds_takes_the_others_value():
    body = rule("location(R, L), L = S -o 1.").body
    assert body == (Atom(0, (Slot(1),), Mode.CONSUME), Bind(2, (Instruction(Op.LOAD, 1),)))


def test_an_expression_in_a_fact_of_the_body_is_an_equation():
    body = rule("p(R, X), q(R, X + 1) -o 1.").body
    assert body[1] == Atom(1, (Slot(2),), Mode.CONSUME)
    assert ops(body[2].code) == [("LOAD", 2), ("LOAD", 1), ("INT", 1), ("ADD", None), ("EQ", None)]


def test_not_matches_anything_where_nothing_else_binds():
    body = rule("not q(R, X, Y, Y, _), p(R, X) -o 1.").body
    assert [each.mode for each in body] == [Mode.CONSUME, Mode.ABSENT]
    bound, first, second, anonymous = body[1].args
    assert (bound, anonymous) == (Slot(1), ANY)
    assert first == second != Slot(1)


def test_a_comprehension_sends_to_other_robots():
    [derived] = rule("online(A, L) -o {B | edge(A, B) | ready(B, A)}.").head
    assert derived == Comprehension(
        (2,), (Atom(1, (Slot(2),), Mode.CONSUME),), (DeriveFact(2, (Instruction(Op.LOAD, 2),), (SELF,)),)
    )


def test_two_comprehensions_have_slots_of_their_own():
    one, other = rule("p(R, X) -o {B | e(R, B) | q(B, X)}, {B, C | f(R, B, C), $g(R, C) | q(B, C), r(C)}.").head
    assert one.slots == (2,)
    assert other.slots == (3, 4)
    assert other.body[1].mode is Mode.KEEP


def test_heads_derive_facts_goals_and_actions():
    head = rule("type action stop(robot). p(R) -o q(R), ?q(R), stop(R), !e(R).").head
    assert [type(each) for each in head] == [DeriveFact, DeriveGoal, DeriveAction, DeriveFact]


# ---- lists


def taken(text):
    """Return the steps that a body takes, each expression as its operations."""
    return [
        each if isinstance(each, Atom) else (type(each).__name__, [name for name, _ in ops(each.code)])
        for each in rule(text).body
    ]


def test_a_list_in_a_fact_is_taken_apart_behind_it():
    body = rule("p(R, [H, _ | T]) -o q(R, H, T).").body
    assert body[0] == Atom(0, (Slot(1),), Mode.CONSUME)
    assert isinstance(body[1], Guard)
    assert ops(body[1].code) == [("LOAD", 1), ("CALL", LEN), ("INT", 2), ("GE", None)]
    assert [(each.slot, ops(each.code)) for each in body[2:]] == [
        (2, [("LOAD", 1), ("INT", 0), ("CALL", NTH)]),
        (3, [("LOAD", 1), ("INT", 2), ("CALL", REST)]),
    ]


def test_a_list_without_a_rest_has_exactly_its_items():
    body = rule("p(R, [A, A]) -o q(R, A).").body
    assert ops(body[1].code)[-1] == ("EQ", None)
    assert [type(each) for each in body[2:]] == [Bind, Guard]


def test_lists_in_lists_are_taken_apart_too():
    assert [kind for kind, _ in taken("p(R, L), L = [[A, 1] | [B | T]] -o q(R, A, B, T).")[1:]] == [
        *["Guard", "Bind", "Guard", "Bind", "Guard"],
        *["Bind", "Guard", "Bind", "Bind"],
    ]


def test_a_part_that_another_fact_binds_is_held_against_it():
    body = rule("p(R, [H | _]), q(R, H) -o 1.").body
    assert [type(each) for each in body] == [Atom, Guard, Atom, Guard]


def test_not_waits_for_what_a_list_binds():
    body = rule("not q(R, H), p(R, L), [H | _] = L -o 1.").body
    assert [type(each) for each in body] == [Atom, Guard, Bind, Atom]
    assert body[-1].mode is Mode.ABSENT


def test_a_list_of_known_parts_is_built():
    head = rule("p(R, X, T) -o q(R, [X, 1 | T]), q(R, [X]).").head
    assert ops(head[0].args[0]) == [("LOAD", 1), ("INT", 1), ("LIST", 2), ("LOAD", 2), ("ADD", None)]
    assert ops(head[1].args[0]) == [("LOAD", 1), ("LIST", 1)]


# ---- aggregates and steps


def test_a_sum_has_slots_of_its_own_and_one_for_its_result():
    [total] = rule("p(R, A) -o [sum X * A => V | q(R, X, Y), Y > A | r(R, V)].").head
    assert (total.operator, total.result, total.slots) == (Operator.SUM, 4, (2, 3))
    assert ops(total.term) == [("LOAD", 2), ("LOAD", 1), ("MUL", None)]
    assert [type(each) for each in total.body] == [Atom, Guard]
    assert total.head == (DeriveFact(2, SELF, ((Instruction(Op.LOAD, 4),),)),)


def test_a_count_has_no_term_and_the_winner_of_min_and_max_may_stand_in_the_head():
    text = "go(R) -o [count => N | $road(R, B, _) | degree(R, N)], [min D => V | road(R, B, D) | nearest(R, B, V)]."
    count, least = rule(text).head
    assert (count.operator, count.term, count.body[0].mode) == (Operator.COUNT, None, Mode.KEEP)
    assert (least.operator, least.slots, least.result) == (Operator.MIN, (3, 4), 5)
    assert least.head[0].args == ((Instruction(Op.LOAD, 3),), (Instruction(Op.LOAD, 5),))
    assert rule(text).slots == 6


def test_steps_are_derived_in_their_order():
    [steps] = rule("type action go(robot, robot). p(R, B) -o go(R, B) then q(B, 1) then ?r(R).").head
    assert isinstance(steps, Steps)
    assert [type(each) for each in steps.steps] == [DeriveAction, DeriveFact, DeriveGoal]
    assert steps.steps[1].owner == (Instruction(Op.LOAD, 1),)


# ---- values


def test_an_int_given_to_a_float_is_converted():
    program = compiled("type p(robot, float). type !q(robot, float). p(R, 2). ?q(R, 3). p(R, 4) -o q(R, 5).")
    assert repr(program.facts[0].args) == "(2.0,)"
    assert repr(program.goals[0].args[0].value) == "3.0"
    assert repr(program.rules[0].body[0].args[0].value) == "4.0"
    assert repr(program.rules[0].head[0].args[0][0].operand) == "5.0"


def test_an_expression_given_to_a_float_is_converted_when_it_may_be_an_int():
    assert code_of("X") == [("LOAD", 1), ("FLOAT", None)]
    assert code_of("X / 2")[-1] == ("DIV", None)
    assert code_of("if(X > 1, X, 0.5)")[-1] == ("FLOAT", None)
    assert code_of("X", "int") == [("LOAD", 1)]


def test_a_facts_variable_owner_is_every_robot():
    program = compiled("p(R, 1). p(@7, 2). ?p(R, X). ?p(@8, 3).")
    assert [each.owner for each in program.facts] == [None, 7]
    assert [(each.owner, each.args) for each in program.goals] == [(None, (ANY,)), (8, (Constant(3),))]


def test_the_owner_as_a_value_of_a_stated_fact_is_the_robot_itself():
    program = compiled("p(R, R, 1). ?q(R, R, X, Y, X). r(R) -o q(R, R, 1, 2, 1).")
    assert program.facts[0].args == (Slot(0), 1)
    first, other, anything, again = program.goals[0].args
    assert (first, other, anything, again) == (Slot(0), Slot(1), ANY, Slot(1))


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("-X", ["LOAD", "NEG"]),
        ("X + 1 - X * 3 % 4", ["LOAD", "INT", "ADD", "LOAD", "INT", "MUL", "INT", "MOD", "SUB"]),
        ("X - -3", ["LOAD", "INT", "SUB"]),
        ("max(X, 2)", ["LOAD", "INT", "CALL"]),
        ("if(X > 1, X, 0)", ["LOAD", "INT", "GT", "JUMP_IF_FALSE", "LOAD", "JUMP", "INT"]),
    ],
)
def test_an_expression_is_code_for_a_stack(expression, expected):
    assert [name for name, _ in code_of(expression, "int")] == expected


@pytest.mark.parametrize(
    ("operator", "op"),
    [("=", Op.EQ), ("!=", Op.NE), ("<>", Op.NE), ("<", Op.LT), ("<=", Op.LE), (">", Op.GT), (">=", Op.GE)],
)
def test_every_comparison_has_its_instruction(operator, op):
    assert rule(f"p(R, X, Y), X {operator} Y -o 1.").body[1].code[-1].op is op


def test_and_or_and_if_decide_lazily_by_jumps_that_fit():
    code = ops(rule("p(R, X), X = 0 || 1 / X > 2 && not (X < 0) -o 1.").body[1].code)
    assert code[3] == ("OR", len(code) - 4)
    conditional = code_of("if(X > 1, X + 1, 0)", "int")
    assert conditional[3] == ("JUMP_IF_FALSE", 4)
    assert conditional[7] == ("JUMP", 1)


@pytest.mark.parametrize("function", [each for each in FUNCTIONS if each.name != "rest"], ids=lambda each: each.name)
def test_every_function_of_the_machine_can_be_called(function):
    arguments = {"id": "R", "len": "L", "nth": "L, 1", "member": "1, L", "sort": "L"}
    given = arguments.get(function.name, ", ".join("X" * function.arity))
    code = rule(f"p(R, L, X) -o q(R, {function.name}({given})).").head[0].args[0]
    assert FUNCTIONS[code[-1].operand] == function


# ---- actions


def test_moveto_without_an_effect_inserts_location_if_the_program_knows_it():
    program = compiled("type action moveto(robot, area). location(R, s). location(R, s) -o moveto(R, t).")
    [effect] = program.predicates[0].effects
    assert program.predicates[effect.predicate].name == "location"
    assert effect.args == ((Instruction(Op.LOAD, 1),),)


@pytest.mark.parametrize(
    "text",
    ["p(R) -o moveto(R, t).", "location(R, a, b). p(R) -o moveto(R, t).", "location(R, 3). p(R) -o moveto(R, t)."],
)
def test_moveto_has_no_effect_if_the_program_does_not_know_that_location(text):
    assert compiled(f"type action moveto(robot, area). {text}").predicates[0].effects == ()


def test_effects_are_over_the_actions_arguments():
    action = compiled("type action blink(R: robot, N: int) -o blinked(R, N * 2), done(R) else stuck(R, N).").predicates[
        0
    ]
    assert [ops(code) for code in action.effects[0].args] == [[("LOAD", 1), ("INT", 2), ("MUL", None)]]
    assert len(action.effects) == 2
    assert action.else_effects[0].args == ((Instruction(Op.LOAD, 1),),)


def test_effects_may_carry_the_bang_and_make_their_fact_persistent():
    program = compiled("type action lift(R: robot, K: int) -o !held(R, K), hand(R) else !stuck(R).")
    lift = program.predicates[program.index("lift")]
    assert [program.predicates[each.predicate].name for each in lift.effects + lift.else_effects] == [
        "held",
        "hand",
        "stuck",
    ]
    kinds = [program.predicates[program.index(name)].kind for name in ("held", "hand", "stuck")]
    assert kinds == [Kind.PERSISTENT, Kind.TEMPORARY, Kind.PERSISTENT]


def test_a_bang_at_an_effect_that_is_declared_temporary_is_an_error():
    text = "type held(robot). type action lift(R: robot) -o !held(R)."
    assert errors(text) == ["E012"]


def test_an_effect_may_be_another_robots():
    text = "type action give(R: robot, B: robot, N: int) -o has(B, N), told(@3) else has(R, N)."
    give = compiled(text).predicates[0]
    assert [each.owner for each in give.effects] == [
        (Instruction(Op.LOAD, 1),),
        (Instruction(Op.CONST, Robot(3)),),
    ]
    assert give.effects[0].args == ((Instruction(Op.LOAD, 2),),)
    assert give.else_effects[0].owner == SELF


# ---- time assertions


def test_a_job_may_end_on_a_robot_that_its_start_names():
    text = "sent(@1, @2). got(@2, @1). x: assert(sent(A, B), got(B, A), 10, warn(B, A))."
    [assertion] = compiled(text).assertions
    assert (assertion.robot, assertion.finisher) == (None, Slot(1))
    assert assertion.finish.args == (Slot(0),)
    assert assertion.violation.owner == (Instruction(Op.LOAD, 1),)


@pytest.mark.parametrize(("finish", "finisher"), [("@1", Slot(0)), ("@2", Constant(Robot(2))), ("B", Slot(1))])
def test_an_assertion_may_be_one_robots(finish, finisher):
    text = f"p(@1, @3). q(R). x: assert(p(@1, B), q({finish}), 10, v(@1))."
    [assertion] = compiled(text).assertions
    assert (assertion.robot, assertion.finisher) == (1, finisher)


def test_an_assertion_binds_by_its_start_fact():
    [assertion] = compiled(CORRIDOR).assertions
    assert assertion.name == "crossing"
    assert assertion.start.args == (Slot(1),)
    assert assertion.finish.args == (Constant(Symbol("exit")),)
    assert ops(assertion.deadline) == [("LOAD", 1)]
    assert assertion.violation.owner == SELF
    assert assertion.scheduled


def test_an_unnamed_assertion_bears_its_finish_facts_name_and_watch_is_never_scheduled():
    [assertion] = compiled("watch(p(R, X), q(R, X, Y, _), 500ms, alarm(R, X)). p(R, X) -o q(R, X, 1, 2).").assertions
    assert (assertion.name, assertion.scheduled, assertion.serving) == ("q", False, ())
    assert assertion.finish.args == (Slot(1), ANY, ANY)
    assert assertion.deadline == (Instruction(Op.CONST, 0.5),)


def serving(text):
    program = compiled(text)
    return [(program.predicates[each.action].name, each.args) for each in program.assertions[0].serving]


def test_the_corridor_is_served_by_moving_to_its_exit():
    assert serving(CORRIDOR) == [("moveto", (Constant(Symbol("exit")),))]
    program = compiled(CORRIDOR)
    assert program.assertions[0].serving == (Serving(program.index("moveto"), (Constant(Symbol("exit")),)),)


def test_an_assertion_is_served_through_rules_by_the_first_actions_and_not_by_what_prepares_them():
    text = """
    type action charge(R: robot) -o charged(R).
    type action go(R: robot, A: area) -o arrived(R, A).
    assert(job(R, A), done(R, A), 10, broadcast(R)).
    job(R, A) -o charge(R).
    charged(R) -o go(R, A1), ready(R).
    arrived(R, A) -o done(R, A).
    """.replace("A1", "home")
    assert serving(text) == [("go", (Slot(1),))]


def test_search_for_serving_actions_keeps_constants_and_ends_on_a_cycle():
    text = """
    type action go(R: robot, A: area) -o here(R, A).
    type action sit(R: robot) -o here(R, chair).
    assert(start(R), end(R), 10, broadcast(R)). start(R).
    here(R, A), A = hall -o end(R). end(R) -o middle(R). middle(R) -o end(R).
    """
    assert serving(text) == [("go", (Constant(Symbol("hall")),))]


def test_facts_sent_by_other_robots_do_not_serve_an_assertion():
    text = "type action go(R: robot) -o here(R). assert(s(R), e(R), 1, v(R)). s(R). here(R), near(R, B) -o e(B)."
    assert serving(text) == []


def test_order_textual_is_kept_and_random_is_the_default():
    assert compiled("order textual.").strategy is Strategy.TEXTUAL
    assert compiled("order random.").strategy is Strategy.RANDOM
    assert compiled("order deadline.").strategy is Strategy.DEADLINE
    assert compiled("").strategy is Strategy.RANDOM


def test_the_debug_section_says_where_everything_stands():
    program = compiled("p(R).\n  p(R) -o q(R).\n")
    assert program.debug is not None
    assert [(each.line, each.column) for each in program.debug.rules] == [(2, 3)]
    assert [(each.line, each.column) for each in program.debug.predicates] == [(1, 1), (2, 11)]
