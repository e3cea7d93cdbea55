"""Every option of `rmr eval`: what it does, and what is said where it cannot be."""

import pytest
from eval_command import actions, facts

from rmr.bytecode.codec import encode
from rmr.eval import given
from rmr.lang.compiler import compile_source

LINKS = "type seen(robot, robot). edge(A, B) -o seen(A, B)."
TEXTUAL = "a(R). a(R) -o x(R, 1). a(R) -o x(R, 2). a(R) -o x(R, 3)."


# -- robots, topology, edges


def test_robots_are_one_unless_told_otherwise(bench):
    assert list(bench.run("p(R).")["robots"]) == ["1"]


def test_edges_are_persistent_facts_both_ways_and_make_an_undeclared_predicate_persistent(bench):
    report = bench.run(LINKS, "--robots", "3", "--topology", "line", "--edges", "edge")
    assert facts(report, 1) == ["!edge(@1, @2)", "seen(@1, @2)"]
    assert facts(report, 2) == ["!edge(@2, @1)", "!edge(@2, @3)", "seen(@2, @1)", "seen(@2, @3)"]
    assert bench.told(LINKS, "--robots", "3", "--edges", "edge") == ""


def test_edges_of_a_declared_predicate_are_the_same(bench):
    report = bench.run("type !edge(robot, robot). " + LINKS, "--robots", "2", "--edges", "edge")
    assert facts(report, 2) == ["!edge(@2, @1)", "seen(@2, @1)"]


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        (LINKS, "egde", "--edges: the program knows no fact `egde`; did you mean `edge`?"),
        (LINKS, "Edge", "--edges: 'Edge' is no name of a predicate; write a name such as edge"),
        (
            "type edge(robot, robot). " + LINKS,
            "edge",
            "`edge` is a temporary fact; declare `type !edge(robot, robot).`",
        ),
        ("type sensor edge(robot, robot). " + LINKS, "edge", "`edge` is a sensed fact"),
        ("type action edge(robot, robot).", "edge", "`edge` is an action"),
        ("type !edge(robot, area). p(R).", "edge", "`edge` does not take two robots"),
        ("type !edge(robot). p(R).", "edge", "`edge` does not take two robots"),
        ("neighbor(R, B) -o p(R, B).", "neighbor", "`neighbor` is a sensed fact"),
    ],
)
def test_edges_that_cannot_be_are_refused(bench, text, name, message):
    assert message in bench.refused(text, "--robots", "2", "--edges", name)


def test_edges_that_would_fill_the_memory_are_refused_with_their_number(bench):
    said = bench.refused(LINKS, "--robots", "10000", "--edges", "edge")
    assert "99990000 facts `edge` are more than 1000000; take fewer robots or another --topology" in said


def test_so_are_those_that_the_robots_would_provide(bench, monkeypatch):
    monkeypatch.setattr(given, "EDGE_FACTS_MAX", 5)
    said = bench.refused("peer(R, B) -o p(R, B).", "--robots", "3", "--topology", "line")
    assert "6 facts `peer` are more than 5; take fewer robots" in said
    assert facts(bench.run("neighbor(R, B) -o p(R, B).", "--robots", "3", "--topology", "line")) == ["p(@1, @2)"]
    bench.refused("neighbor(R, B) -o p(R, B).", "--robots", "3")


def test_who_is_in_range_is_a_neighbour_a_metre_away_and_all_are_peers(bench):
    text = "neighbor(R, B) -o n(R, B). peer(R, B) -o p(R, B). range(R, B, D) -o d(R, B, D)."
    report = bench.run(text, "--robots", "3", "--topology", "line")
    assert facts(report) == ["d(@1, @2, 1.0)", "n(@1, @2)", "p(@1, @2)", "p(@1, @3)"]


def test_a_topology_of_a_file_decides_who_hears_whom(bench):
    net = bench.file("net", "1 3\n")
    report = bench.run("tell(@1). tell(A) -o told(@3, A).", "--robots", "3", "--topology", net)
    assert facts(report, 3) == ["told(@3, @1)"]
    assert facts(bench.run(LINKS, "--robots", "3", "--topology", net, "--edges", "edge"), 2) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--robots", "0"], "rmr eval: --robots: 1 to 65533 robots"),
        (["--topology", "circle"], "rmr eval: --topology: there is no file 'circle'"),
        (["--until", "soon"], "rmr eval: --until: 'soon' is no duration"),
        (["--latency", "-1ms"], "rmr eval: --latency: '-1ms' is no duration"),
        (["--action-time", "x"], "rmr eval: --action-time: 'x' is no duration"),
        (["--loss", "2"], "rmr eval: --loss: a share from 0 to 1"),
        (["--seed", "-1"], "rmr eval: --seed: a whole number from 0"),
        (["--strategy", "best"], "rmr eval: --strategy: one of random, textual, deadline, not 'best'"),
        (["--engine", "clips"], "rmr eval: --engine: one of interpreter, generated, columnar, not 'clips'"),
        (["--insert", "2s"], "--insert '2s': '2s' is no time and fact; write '2.5s: online(@3, l1)'"),
        (["--insert", "x: p(@1)"], "--insert 'x: p(@1)': 'x' is no duration"),
    ],
)
def test_a_wrong_value_is_wrong_usage(bench, arguments, message):
    said = bench.refused("p(R).", *arguments)
    assert message in " ".join(said.split())
    assert "Traceback" not in said


# -- facts


def test_more_initial_facts_come_from_a_file(bench):
    more = bench.file("more.rmr", "// two of them\nq(@1, 2.5). q(@2, 3).\nr(R).\n!s(@2).\n")
    text = "type q(robot, float). q(R, X), r(R) -o t(R, X). s(R) -o u(R)."
    report = bench.run(text, "--robots", "2", "--facts", more)
    assert facts(report, 1) == ["t(@1, 2.5)"]
    assert facts(report, 2) == ["!s(@2)", "t(@2, 3.0)", "u(@2)"]
    assert bench.told(text, "--robots", "2", "--facts", more) == ""


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("q(@1, 2,).", "more.rmr:1:8: error[E001]"),
        ("deu(@1).", "more.rmr:1:1: error[E015]: the program knows no fact `deu`\n"),
        ("deu(@1).", "hint: did you mean `due`?"),
        ("q(@1).", "more.rmr:1:1: error[E011]: `q` has 2 arguments, not 1"),
        ("q(@1, gate).", "more.rmr:1:7: error[E020]: an argument of `q` is float, not symbol"),
        ("q(1, 1).", "more.rmr:1:3: error[E021]: the first argument is a robot"),
        ("q(@1, X).", "more.rmr:1:7: error[E023]"),
        ("!q(@1, 1).", "more.rmr:1:1: error[E012]: `q` is a temporary fact, not a persistent one"),
        ("go(@1).", "more.rmr:1:1: error[E012]: `go` is an action, not a fact"),
        ("?q(@1, 1).", "more.rmr:1:1: error[E012]: a file of facts holds facts alone, such as `due(@1, 25).`"),
        ("q(R, 1) -o q(R, 2).", "more.rmr:1:1: error[E012]: a file of facts holds facts alone"),
    ],
)
def test_a_mistake_in_a_file_of_facts_is_a_diagnostic(bench, line, message):
    more = bench.file("more.rmr", line + "\nq(@1, true).\n")
    said = bench.refused(
        "type q(robot, float). type action go(robot). q(R, X), due(R) -o go(R).", "--facts", more, code=3
    )
    assert message in said
    assert "E020" in said, "and the next one is reported as well"


def test_mistakes_of_the_program_and_of_the_facts_are_told_together(bench):
    said = bench.refused("p(R, X).", "--facts", bench.file("more.rmr", "?p(R)."), code=3)
    assert "p.rmr:1:6: error[E023]" in said
    assert "more.rmr:1:1: error[E012]" in said


def test_a_missing_file_is_wrong_usage(bench):
    assert "no such file" in bench.refused("p(R).", "--facts", str(bench.folder / "none.rmr"))
    missing = bench.call(str(bench.folder / "none.rmr"))
    assert (missing.exit_code, missing.stdout) == (2, "")
    assert bench.call(str(bench.folder / "none.rbc")).exit_code == 2
    assert bench.call(str(bench.folder)).exit_code == 2
    assert bench.call().exit_code == 2


def test_what_is_stated_for_robots_that_are_not_there_is_dropped_with_a_warning(bench):
    text = "p(@1). p(@7). p(@7). ?q(@8). p(R) -o q(R)."
    said = bench.told(text, "--robots", "2", "--insert", "1s: p(@9)")
    assert said.count("robot 7 is not among the robots; `p` that is stated for it is dropped") == 1
    assert "robot 8 is not among the robots; `q`" in said
    assert "robot 9 is not among the robots; `p`" in said
    report = bench.run(text, "--robots", "2", "--insert", "1s: p(@9)")
    assert report["quiescent"]
    assert list(report["robots"]) == ["1", "2"]


def test_so_is_what_is_derived_for_them(bench):
    text = "go(@1). go(A) -o told(@9, A)."
    assert "`told` of robot 1 did not reach robot 9: no such robot" in bench.told(text, "--robots", "2")
    report = bench.run(text, "--robots", "2")
    assert report["quiescent"]
    assert report["robots"]["1"]["undelivered"] == 1


# -- events from outside


def test_an_event_comes_from_outside_at_its_instant(bench):
    report = bench.run("p(R) -o q(R, now()).", "--insert", "2.5s: p(@1)", "--insert", "1: p(@1)")
    assert facts(report) == ["q(@1, 1.0)", "q(@1, 2.5)"]
    assert report["time_s"] == 2.5


@pytest.mark.parametrize(
    ("text", "fact", "expected"),
    [
        ("s(R, A) -o t(R, A).", "s(@1, anywhere)", "t(@1, anywhere)"),
        ("type sensor s(robot, area). s(R, A) -o t(R, A).", "s(@1, gate)", "t(@1, gate)"),
        ("at(R, A) -o t(R, A).", "at(@1, gate)", "t(@1, gate)"),
        ("failed(R, B, E) -o t(R, B, E).", "failed(@1, @2, go)", "t(@1, @2, go)"),
        ("s(R, X) -o t(R, X).", "!s(@1, 5)", "t(@1, 5)"),
        ("type s(robot, float). s(R, X) -o t(R, X).", "s(@1, 500ms)", "t(@1, 0.5)"),
        ("s(R) -o t(R).", "s(Everybody)", "t(@1)"),
    ],
)
def test_any_predicate_may_come_from_outside(bench, text, fact, expected):
    report = bench.run(text, "--insert", f"1s: {fact}")
    assert expected in facts(report)
    assert "W102" not in bench.told(text, "--insert", f"1s: {fact}")


def test_a_program_that_an_inserted_fact_starts_is_not_called_unstarted(bench):
    text = "type s(robot). s(R) -o t(R)."
    assert "W115" in bench.told(text)
    assert "W115" not in bench.told(text, "--insert", "1s: s(@1)")


def test_a_bang_makes_an_undeclared_predicate_persistent_and_leaves_its_fact_in_place(bench):
    assert facts(bench.run("s(R, X) -o t(R, X).", "--insert", "1s: !s(@1, 5)")) == ["!s(@1, 5)", "t(@1, 5)"]


def test_a_variable_owner_is_every_robot(bench):
    report = bench.run("p(R) -o q(R).", "--robots", "3", "--insert", "1s: p(R)")
    assert [facts(report, robot) for robot in (1, 2, 3)] == [["q(@1)"], ["q(@2)"], ["q(@3)"]]


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ("1s: deu(@1)", "--insert '1s: deu(@1)': the program knows no fact `deu`; did you mean `due`?"),
        ("1s: p(@1, 2)", "`p` has 1 argument, not 2"),
        ("1s: p(@1", "a `)` is missing"),
        ("1s: p(1)", "the first argument is a robot"),
        ("1s: ?p(@1)", "this is not a fact"),
        ("1s: go(@1)", "`go` is an action, not a fact"),
        ("1s: f(@1, gate)", "an argument of `f` is float, not symbol"),
    ],
)
def test_an_event_that_is_no_fact_of_the_program_is_refused(bench, event, message):
    text = "type action go(robot). type f(robot, float). p(R) -o go(R). f(R, X), due(R) -o p(R)."
    assert message in " ".join(bench.refused(text, "--insert", event).split())


def test_a_sensed_fact_from_outside_stays_until_an_effect_takes_its_place(bench):
    text = """
    type sensor at(robot, area).  type action go(R: robot, A: area) -o at(R, A).
    at(R, a) -o seen(R, a).  at(R, b) -o seen(R, b).
    ask(R, A) -o go(R, A).  look(R), at(R, A) -o there(R, A).
    """
    events = ["0s: at(@1, a)", "1s: ask(@1, b)", "2s: look(@1)", "3s: look(@1)"]
    report = bench.run(text, *(word for event in events for word in ("--insert", event)), "--action-time", "100ms")
    assert facts(report) == ["seen(@1, a)", "seen(@1, b)", "there(@1, b)", "there(@1, b)"]


# -- actions, strategy, seed, byte-code


def test_an_action_takes_its_time_before_its_effect(bench):
    text = "type action go(R: robot) -o there(R). p(R). p(R) -o go(R). there(R) -o done(R, now())."
    report = bench.run(text, "--action-time", "1.5s")
    assert (actions(report), facts(report)) == ([[0.0, "go(@1)"]], ["done(@1, 1.5)"])
    report = bench.run(text)
    assert (actions(report), facts(report)) == ([[0.0, "go(@1)"]], ["done(@1, 0.0)"])


@pytest.mark.medium
def test_the_strategy_may_be_another_than_the_programs(bench):
    def chosen(text, *arguments):
        found = [facts(bench.run(text, "--seed", str(seed), *arguments))[0] for seed in range(12)]
        return sorted(set(found))

    assert chosen(TEXTUAL) == ["x(@1, 1)", "x(@1, 2)", "x(@1, 3)"]
    assert chosen(TEXTUAL, "--strategy", "textual") == ["x(@1, 1)"]
    assert chosen("order textual. " + TEXTUAL) == ["x(@1, 1)"]
    assert len(chosen("order textual. " + TEXTUAL, "--strategy", "random")) == 3


def test_byte_code_runs_like_its_source(bench):
    source = bench.file("p.rmr", "type !edge(robot, robot). " + LINKS)
    program = compile_source((bench.folder / "p.rmr").read_text()).program
    (bench.folder / "p.rbc").write_bytes(encode(program, debug=False))
    arguments = ("--robots", "3", "--edges", "edge", "--insert", "1s: seen(@1, @1)")
    assert bench.call(source, *arguments).stdout == bench.call(str(bench.folder / "p.rbc"), *arguments).stdout


@pytest.mark.parametrize("octets", [b"", b"p(R).\n", b"RMR\x1a", b"RMR\x1a" + b"\xff" * 100])
def test_what_is_no_byte_code_is_an_invalid_program(bench, octets):
    (bench.folder / "x.rbc").write_bytes(octets)
    result = bench.call(str(bench.folder / "x.rbc"))
    assert (result.exit_code, result.stdout) == (3, "")
    assert "no valid byte-code" in result.stderr


def test_an_invalid_program_is_told_by_its_diagnostics(bench):
    assert "p.rmr:1:6: error[E023]" in bench.refused("p(R, X).", code=3)
