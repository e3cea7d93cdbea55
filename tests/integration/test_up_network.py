"""Robots that have a network, as processes: frames cross the bus as they are, farther than a radio reaches."""

from greeting_program import PROGRAM

LAB = """
lab: far
program: far.rmr
duration: 60s
finish: greeted(R, @1)
arena: {size: [91.0, 2.0]}
robots:
  - {ids: 1-3, grid: {from: [0.5, 0.5], step: [45.0, 0.4], columns: 3}}
radio: {mode: network}
"""


def test_processes_hear_each_other_over_the_network_where_no_radio_reaches(tmp_path, up):
    (tmp_path / "lab.yaml").write_text(LAB)
    (tmp_path / "far.rmr").write_text(PROGRAM)
    launched = up(tmp_path / "lab.yaml")
    assert launched.wait(280) == 0, launched.out + launched.err
    report = launched.report()
    assert report["finished"]
    for robot in report["robots"].values():
        counters = robot["frames"]
        assert counters["received"] > 0
        assert {counters[name] for name in ("collided", "deaf", "dropped", "malformed", "late", "blind")} == {0}
