"""What went wrong in a run that ended well, in a sentence of each kind."""

from rmr_world.run_warnings import TEXT_MAX, run_warnings


def robot(**fields):
    return {"actions": [[0.0, "act(@1)"]], "actions_omitted": 0, "undelivered": 0, **fields}


def test_a_run_in_which_nothing_went_wrong_has_no_troubles():
    assert run_warnings({"robots": {"1": robot(), "2": {}}}) == []


def test_failed_actions_are_counted_over_all_robots_and_the_earliest_is_named():
    first = robot(actions_failed=2, first_failure=[3.0, "act(@1)", "late"])
    second = robot(actions_failed=1, actions_omitted=7, first_failure=[1.5, "act(@2)", "KeyError: 'x' (acts.py:7)"])
    assert run_warnings({"robots": {"1": first, "2": second}}) == [
        "3 actions failed, of 9 started; the first: robot 2 at 1.500 s: act(@2): KeyError: 'x' (acts.py:7)",
        "the report leaves out the 7 oldest actions",
    ]


def test_undelivered_facts_are_counted_and_a_long_fact_is_cut():
    fact = 'got(@2, "' + "x" * 7000
    (line,) = run_warnings({"robots": {"1": robot(undelivered=1, first_undelivered=[0.0, fact, "too large"])}})
    assert line.startswith(
        "1 of the facts, goals and actions for other robots not delivered; the first: robot 1 at 0.000"
    )
    assert line.endswith(f"{fact[:TEXT_MAX]}...: too large")


def test_dropped_and_omitted_entries_are_reported():
    part = robot(actions_omitted=5, assertions_omitted=2, goals_omitted=1, dropped={"facts": 3})
    assert run_warnings({"robots": {"1": part}, "violations_omitted": 4}) == [
        "robot 1 dropped 3 facts: more than it keeps (`bound_reached` in its trace)",
        "the report leaves out the 5 oldest actions",
        "the report leaves out the 2 oldest jobs, which `deadlines` does not count",
        "the report leaves out the 1 oldest achieved goals",
        "the report leaves out 4 violations",
    ]


def test_senders_beyond_their_rate_stand_among_the_warnings_of_a_run():
    said = run_warnings({"robots": {}, "bus": {"lost": 0, "excess": [[-2, 3], [4, 5000]]}})
    assert [line.partition(":")[0] for line in said] == [
        "an operator sent more on the bus than others take of one sender",
        "robot 4 sent more on the bus than others take of one sender",
    ]
    assert "5000 of its messages were dropped; its program is wrong, or somebody has its keys" in said[1]
