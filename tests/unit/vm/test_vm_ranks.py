"""How far a firing is from an open goal, and what the machine makes of it; programs in source text."""

import pytest
from vm_hand import INT, Hand, V, actions, code, fired, guard, machine_of, started

from rmr.analysis import goal_levels
from rmr.analysis.backward_chaining import Backwards
from rmr.analysis.goal_levels import Levels
from rmr.base.values import Robot, Symbol
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import ANY, Constant, Lead, Program
from rmr.lang.compiler import compile_source
from rmr.vm import ranks
from rmr.vm.machine import Machine

pytestmark = pytest.mark.usefixtures("each_engine")

SEEDS = range(20)


def compiled(text: str) -> Program:
    compilation = compile_source(text)
    assert compilation.program is not None, compilation.errors
    return compilation.program


def machine(text: str, seed: int = 0, robot: int = 1) -> Machine:
    return started(compiled(text), robot, seed)


def way(text: str, seed: int = 0) -> list[int]:
    """Return the rules that fire, in their order."""
    return fired(machine(text, seed).drain())


def level(text: str, fact: str, *args: object, robot: int = 1) -> int | None:
    """Return the rank of a fact, given the goals that the program states for every robot."""
    program = compiled(text)
    index = program.index(fact)
    assert index is not None
    goals = [(goal.predicate, goal.args) for goal in program.goals]
    ranked = Levels(Backwards(program), goals, Robot(robot))
    return ranked.lowest([(index, tuple(Symbol(a) if type(a) is str else a for a in args))])  # type: ignore[misc]


TWO_WAYS = "?g(R). a(R). a(R) -o b(R). a(R) -o c(R). b(R) -o g(R). c(R) -o d(R)."


def test_a_firing_goes_by_the_fact_from_which_another_one_derives_the_goal() -> None:
    assert {tuple(way(TWO_WAYS, seed)) for seed in SEEDS} == {(0, 2)}


def test_without_the_goal_both_ways_are_taken() -> None:
    free = TWO_WAYS.removeprefix("?g(R).")
    assert {tuple(way(free, seed)) for seed in SEEDS} == {(0, 2), (1, 3)}


def test_a_chain_is_seen_from_its_beginning() -> None:
    text = "?g(R). a(R). a(R) -o x(R). a(R) -o b(R). x(R) -o 1. b(R) -o c(R). b(R) -o x(R). c(R) -o x(R). c(R) -o g(R)."
    assert {tuple(way(text, seed)) for seed in SEEDS} == {(1, 3, 6)}
    assert [level(text, name) for name in "gcbax"] == [0, 1, 2, 3, None]


def test_the_shortest_way_is_taken_although_a_longer_one_leads_there() -> None:
    text = "?g(R). a(R). a(R) -o b(R). b(R) -o c(R). c(R) -o g(R). a(R) -o c(R)."
    assert {tuple(way(text, seed)) for seed in SEEDS} == {(3, 2)}


def test_the_order_of_the_text_decides_among_firings_of_one_rank_only() -> None:
    text = (
        "order textual. ?g(R). a(R). a(R) -o x(R). a(R) -o c(R). a(R) -o b(R). b(R) -o g(R). c(R) -o g(R). x(R) -o 1."
    )
    assert way(text) == [1, 4]


def test_a_draw_is_made_among_firings_of_the_best_rank() -> None:
    text = "?g(R). a(R). a(R) -o x(R). a(R) -o c(R). a(R) -o b(R). b(R) -o g(R). c(R) -o g(R). x(R) -o 1."
    assert {tuple(way(text, seed)) for seed in SEEDS} == {(1, 4), (2, 3)}


def test_a_loop_among_rules_ends_and_is_left_for_the_goal() -> None:
    text = "?g(R). a(R). a(R) -o b(R). b(R) -o a(R). b(R) -o c(R). c(R) -o c(R). c(R) -o g(R)."
    assert {tuple(way(text, seed)) for seed in SEEDS} == {(0, 2, 4)}
    assert level(text + " z(R) -o z(R).", "z") is None


def test_a_loop_that_changes_its_arguments_ends() -> None:
    text = "?g(R, 1, 2). g(R, X, Y) -o g(R, Y, X). g(R, X, Y) -o g(R, X + 1, Y). start(R). start(R) -o start(R)."
    assert level(text, "g", 2, 1) == 1
    assert level(text, "g", 7, 2) == 1
    assert level(text, "g", 2, 7) == 2
    assert level(text, "start") is None


def test_two_matches_of_one_rule_may_have_different_ranks_and_the_best_goes_first() -> None:
    text = """
    ?at(R, c). go(R). near(R, d). near(R, a). near(R, b).
    go(R), near(R, X) -o at(R, X).
    at(R, a) -o at(R, b).
    at(R, b) -o at(R, c).
    """
    assert [level(text, "at", area) for area in "cbad"] == [0, 1, 2, None]
    made = machine(text)
    assert fired(made.drain()) == [0, 2]
    assert made.facts() == ["at(@1, c)", "near(@1, a)", "near(@1, d)"]


def test_of_the_matches_of_one_rank_the_oldest_go_first() -> None:
    text = "?g(R, _). go(R). n(R, 3). n(R, 1). n(R, 2). go(R), n(R, X) -o h(R, X). h(R, X), X < 3 -o g(R, X)."
    assert machine(text).facts() == ["h(@1, 3)", "n(@1, 1)", "n(@1, 2)"]
    assert machine(text.replace("X < 3", "X = 1")).facts() == ["g(@1, 1)", "n(@1, 2)", "n(@1, 3)"]


def test_what_a_variable_must_be_is_carried_from_premise_to_premise() -> None:
    text = "?g(R, k). a(R, X, Y) -o b(R, Y, X). b(R, X, X) -o c(R, X). c(R, X) -o g(R, X). a(R, k, k)."
    assert level(text, "a", "k", "k") == 3
    assert level(text, "a", "k", "m") is None
    assert level(text, "c", "m") is None


def test_a_variable_twice_is_one_value_whatever_it_is() -> None:
    text = "?g(R). a(R, X, X) -o g(R). a(R, k, k)."
    assert level(text, "a", "m", "m") == 1
    assert level(text, "a", "k", "m") is None


def test_conditions_that_equate_are_kept_and_others_taken_for_granted() -> None:
    text = "?g(R). a(R, X), Y = X, Y = k -o b(R, Y). b(R, X), X != k -o g(R). a(R, k)."
    assert level(text, "a", "k") == 2
    assert level(text, "a", "m") is None


def test_an_int_is_the_float_that_it_becomes() -> None:
    text = "type g(robot, float). ?g(R, 2). a(R, 2). a(R, 3). a(R, X) -o g(R, X)."
    assert level(text, "a", 2) == 1
    assert level(text, "a", 3) is None


def test_persistent_and_sensed_facts_lead_on_as_others_do_and_absent_ones_do_not() -> None:
    text = """
    type !known(robot). type sensor seen(robot, area). type action look(R: robot, A: area) -o seen(R, A).
    ?g(R). a(R). a(R) -o look(R, east). a(R) -o look(R, west). a(R) -o known(R).
    seen(R, west), not known(R) -o g(R).
    """
    assert [action.args for seed in SEEDS for action in actions(machine(text, seed).drain())] == [("west",)] * 20
    assert level(text, "known") is None


def test_the_way_leads_through_the_effect_of_moveto() -> None:
    text = """
    type action moveto(robot, area).
    ?location(R, t). location(R, s).
    location(R, s) -o moveto(R, cellar).
    location(R, s) -o moveto(R, middle).
    location(R, middle) -o moveto(R, t).
    """
    for seed in SEEDS:
        made = machine(text, seed)
        went = []
        while todo := actions(made.drain()):
            for action in todo:
                went.append(str(action.args[0]))
                made.complete(0, action.serial, True)
            made.run(0)
        assert went == ["middle", "t"]


def test_an_effect_that_computes_may_bring_about_anything() -> None:
    text = """
    type action add(R: robot, N: int, M: int) -o sum(R, N + M), last(R, M).
    ?g(R). a(R). a(R) -o add(R, 1, 2). a(R) -o idle(R). sum(R, 5) -o g(R). last(R, 3) -o h(R).
    """
    assert level(text, "sum", 5) == 1
    assert level(text, "sum", 6) is None
    assert level(text, "a") == 2
    assert {tuple(way(text, seed)) for seed in SEEDS} == {(0,), (1,)}, (
        "add(R, 1, 2) makes sum(R, 3), from which nothing"
    )


def test_comprehensions_lead_on_from_what_they_match() -> None:
    text = "?g(R, 4). t(R). n(R, 4). t(R) -o {N | n(R, N), N != 0 | g(R, N)}. a(R) -o n(R, 4). b(R) -o t(R)."
    assert (level(text, "n", 4), level(text, "n", 5)) == (1, None)
    assert [level(text, name) for name in "tab"] == [1, 2, 2]


def test_aggregates_lead_on_from_what_they_match_to_any_value() -> None:
    text = "?g(R, 4). t(R). n(R, 4, 1). t(R) -o [sum X => V | n(R, X, Y), Y > 0 | g(R, V)]. a(R) -o n(R, 9, 1)."
    assert (level(text, "n", 7, 2), level(text, "a"), level(text, "g", 5)) == (1, 2, None)


def test_an_aggregate_that_is_won_keeps_what_it_is_won_with() -> None:
    text = "?near(R, b). t(R). way(R, b, 1). t(R) -o [min D => V | way(R, B, D), D < 9 | near(R, B)]."
    assert (level(text, "way", "b", 3), level(text, "way", "c", 3)) == (1, None)


def test_every_step_leads_on() -> None:
    text = "type action look(R: robot) -o seen(R). ?g(R). t(R). t(R) -o look(R) then a(R) then b(R). {} -o g(R)."
    assert [level(text.format(name), "t") for name in ("seen(R)", "a(R)", "b(R)", "c(R)")] == [2, 2, 2, None]


def test_effects_count_at_the_robot_that_gets_them() -> None:
    text = """
    type action give(R: robot, B: robot) -o has(B).
    ?g(R). a(R). a(R) -o give(R, @2). b(R) -o give(@2, R). has(R) -o g(R). c(R) -o give(R, R).
    """
    assert [level(text, name) for name in "abc"] == [None, 2, 2]
    assert [level(text, name, robot=2) for name in "abc"] == [2, 2, 2]
    for seed in SEEDS:
        made = machine(text + " a(R) -o x(R). x(R) -o 1. b(R) -o x(R). b(R).", seed)
        assert fired(made.drain())[0] == 1


def test_a_goal_may_want_the_same_twice_and_the_robot_itself() -> None:
    assert level("?p(R, X, X). q(R, 1). q(R, N) -o p(R, N, 1).", "q", 1) == 1
    assert level("?p(R, X, X). q(R, 1). q(R, N) -o p(R, N, 1).", "q", 2) is None
    text = "?link(R, R). q(R, @1). q(R, B) -o link(R, B)."
    assert (level(text, "q", Robot(1)), level(text, "q", Robot(2))) == (1, None)


def test_a_list_that_is_built_may_be_any() -> None:
    text = "?g(R, [1, 2]). q(R, 7). q(R, N) -o g(R, [N, 2]). p(R, L), L = [1, 2] -o g(R, L). p(R, [3])."
    assert level(text, "q", 7) == 1
    assert (level(text, "p", (1, 2)), level(text, "p", (1, 3))) == (1, None)


def test_only_facts_of_the_home_robot_count() -> None:
    text = "?g(R). a(R, @2). a(R, B) -o b(B). a(R, B) -o c(R). b(R) -o g(R). c(R) -o x(R). x(R) -o 1."
    assert level(text, "a", Robot(1)) is None
    assert {way(text, seed)[0] for seed in SEEDS} == {0, 1}


def test_a_rule_for_one_robot_leads_on_at_that_robot_only() -> None:
    text = "?g(R). a(@1) -o g(@1). a(R) -o x(R). x(R) -o 1."
    assert level(text, "a", robot=1) == 1
    assert level(text, "a", robot=2) is None


def test_ranks_follow_the_goals_as_they_open_and_are_achieved() -> None:
    text = """
    type token(robot). type g(robot). type h(robot).
    token(R) -o b(R). token(R) -o c(R). b(R) -o g(R). c(R) -o h(R). ask(R) -o ?h(R). ask(R).
    """
    program = compiled(text)
    token, g = program.index("token"), program.index("g")
    assert token is not None
    assert g is not None
    for seed in SEEDS:
        made = started(program, seed=seed)
        made.drain()
        made.insert(0, token, ())
        made.run(0)
        assert fired(made.drain()) == [1, 3]
        made.want(0, g, ())
        made.insert(0, token, ())
        made.run(0)
        assert fired(made.drain()) == [0, 2]


def test_a_goal_that_opens_ranks_matches_that_were_there_before() -> None:
    text = "order textual. type go(robot). a(R). go(R), a(R) -o x(R). a(R), go(R) -o b(R). b(R) -o g(R). x(R) -o 1."
    program = compiled(text)
    go, g = program.index("go"), program.index("g")
    assert go is not None
    assert g is not None
    made = machine_of(program)
    made.start(0)
    made.insert(0, go, ())
    made.want(0, g, ())
    made.run(0)
    assert fired(made.drain()) == [1, 2]


def test_conditions_in_code_made_by_hand_are_kept() -> None:
    hand = Hand()
    a, b, g = hand.temporary("a", INT), hand.temporary("b"), hand.temporary("g")
    hand.goal(g)
    hand.rule([hand.atom(a, V(1)), guard(3, V(1), Op.EQ)], [hand.head(b)])
    hand.rule([hand.atom(a, V(1)), guard(3, 4, Op.EQ)], [hand.head(g)])
    hand.rule([hand.atom(a, V(1)), guard(V(1), 9, Op.EQ)], [hand.head(b, to=code(V(0)))])
    hand.rule([hand.atom(b)], [hand.head(g)])
    ranked = Levels(Backwards(hand.program()), [(g, ())], Robot(1))
    assert [ranked.lowest([(a, (number,))]) for number in (3, 4, 9)] == [2, None, 2]


def grid(size: int) -> str:
    """A program that knows a grid of areas and how to go from each to its four neighbours."""
    rules = [
        f"in(R, a{x}_{y}) -o in(R, a{x + dx}_{y + dy})."
        for x in range(size)
        for y in range(size)
        for dx, dy in ((0, 1), (1, 0), (0, -1), (-1, 0))
        if 0 <= x + dx < size and 0 <= y + dy < size
    ]
    return f"?in(R, a{size - 1}_{size - 1}). in(R, a0_0).\n" + "\n".join(rules)


def test_the_way_through_a_grid_of_rules_is_the_shortest() -> None:
    made = machine(grid(7))
    assert made.goals()["open"] == []
    assert len(fired(made.drain())[:13]) >= 12
    assert level(grid(7), "in", "a0_0") == 12


def test_goal_rank_search_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goal_levels, "STEPS_MAX", 20)
    text = "?p(R, 9, 9). " + " ".join(f"p(R, {n}, X) -o p(R, {n + 1}, X)." for n in range(30))
    assert level(text, "p", 8, 9) == 1
    text = text.replace("?p(R, 9, 9)", "?p(R, 30, 9)")
    assert level(text, "p", 0, 9) is None
    assert level(text, "p", 29, 9) == 1


def test_machines_without_goals_do_not_read_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(ranks, "Backwards", never)
    assert len(way(TWO_WAYS.removeprefix("?g(R)."))) == 2


def test_goals_that_the_compiler_has_worked_out_need_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(ranks, "Backwards", never)
    assert {tuple(way(TWO_WAYS, seed)) for seed in SEEDS} == {(0, 2)}
    with pytest.raises(AssertionError):
        way(TWO_WAYS + " go(R). go(R) -o ?h(R), i(R). i(R) -o h(R). h(R) -o 1.")


def test_match_dependent_rank_is_searched_at_run_time_beside_precomputed_goals() -> None:
    text = """
    ?at(R, c). go(R). near(R, d). near(R, a). near(R, b).
    go(R), near(R, X) -o at(R, X).
    at(R, a) -o at(R, b).
    at(R, b) -o at(R, c).
    """
    program = compiled(text)
    assert program.goals[0].leads == (Lead(0, None), Lead(1, 1), Lead(2, 0))
    assert fired(machine(text).drain()) == [0, 2]


def test_several_goals_give_a_rule_the_rank_of_the_nearest() -> None:
    goals = [{0: 3, 1: ranks.SEARCH, 2: ranks.SEARCH}, {0: 1, 1: 2, 2: 0, 3: ranks.SEARCH}]
    assert ranks.merged(goals) == {0: 1, 1: ranks.SEARCH, 2: 0, 3: ranks.SEARCH}
    assert ranks.merged(goals) == ranks.merged(reversed(goals))


def test_goal_with_open_arguments_is_achieved_by_any_derivation() -> None:
    program = compiled("type g(robot, int). a(R). a(R) -o g(R, 3).")
    ranked = Levels(Backwards(program), [(0, (ANY,)), (0, (Constant(3),))], Robot(1))
    assert ranked.lowest([(0, (5,))]) == 0
    assert ranked.lowest([(0, (3,))]) == 0
