"""What a person sees: few plain lines, one table, one summary."""

import io

import pytest
from rich.console import Console

from rmr_deploy.screen import LiveScreen, PlainScreen, RobotLine, table


def job(deadline_s=25.0, finish_s=None, met=None, text="crossing(@1, exit)"):
    return {"job": text, "deadline_s": deadline_s, "finish_s": finish_s, "met": met}


def report(**robots):
    parts = {name.lstrip("r"): {"finish_s": None, "assertions": jobs} for name, jobs in robots.items()}
    return {
        "robots": parts,
        "finished": True,
        "time_s": 21.4,
        "bound_s": 17.0,
        "deadlines": {"met": 6, "missed": 0},
        "collisions": 0,
    }


def text_of(drawable) -> str:
    console = Console(file=io.StringIO(), width=100)
    console.print(drawable)
    return console.file.getvalue()


@pytest.fixture
def output():
    return io.StringIO()


@pytest.fixture
def plain(output):
    return PlainScreen(Console(file=output, width=80, soft_wrap=True))


def test_a_change_of_state_is_written_at_once(plain, output):
    plain.show(None, [RobotLine(1, "starting", "")])
    plain.show(0.1, [RobotLine(1, "running", "waiting")])
    plain.show(0.2, [RobotLine(1, "finished", "finished at 0.2 s")])
    assert output.getvalue().splitlines() == [
        "robot 1  starting",
        "    0.1 s  robot 1  running  waiting",
        "    0.2 s  robot 1  finished  finished at 0.2 s",
    ]


def test_changed_measurement_prints_no_line_but_changed_crossing_state_does(plain, output):
    for tenth in range(30):
        plain.show(tenth / 10, [RobotLine(1, "running", f"turn {2 - tenth // 15} in {3 - tenth / 10:.1f} s")])
    assert output.getvalue().splitlines() == [
        "    0.0 s  robot 1  running  turn 2 in 3.0 s",
        "    1.5 s  robot 1  running  turn 1 in 1.5 s",
    ]


def test_nothing_is_written_twice(plain, output):
    for second in range(0, 60, 10):
        plain.show(float(second), [RobotLine(1, "running", "waiting")])
    assert len(output.getvalue().splitlines()) == 1


def test_robot_output_is_shown_as_text_without_markup_or_control_characters(plain, output):
    plain.show(None, [RobotLine(1, "running", "[bold]x[/bold] \x1b[2J")])
    assert "[bold]x[/bold]" in output.getvalue()
    assert "\x1b" not in output.getvalue()


def test_the_live_screen_keeps_one_line_for_each_robot(output):
    screen = LiveScreen(Console(file=output, width=80, force_terminal=True, color_system=None))
    screen.show(1.5, [RobotLine(1, "running", "moveto(@1, exit), turn 2 in 3.1 s"), RobotLine(2, "finished", "")])
    screen.close()
    assert "1.5 s, 1 of 2 finished" in output.getvalue()
    assert "robot 1" in output.getvalue()
    assert "moveto(@1, exit), turn 2 in 3.1 s" in output.getvalue()


def test_the_table_shows_deadline_finish_lateness_and_whether_it_was_met():
    lines = text_of(table(report(r1=[job(25.0, 26.25, False)], r2=[job(20.0, 12.0, True)]))).splitlines()
    assert [line.split() for line in lines] == [
        ["robot", "deadline", "finish", "lateness", "met"],
        ["@2", "20.00", "s", "12.00", "s", "-8.00", "s", "yes"],
        ["@1", "25.00", "s", "26.25", "s", "+1.25", "s", "no"],
    ]


def test_the_table_names_the_jobs_where_a_robot_had_several():
    again = {**job(25.0, 26.25, False), "job": "at(@1, west)"}
    lines = text_of(table(report(r1=[{**again, "job": "at(@1, east)"}, again]))).splitlines()
    assert [line.rstrip().rpartition("  ")[2] for line in lines] == ["job", "at(@1, east)", "at(@1, west)"]
