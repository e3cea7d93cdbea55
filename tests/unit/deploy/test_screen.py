"""What a file gets of a run: few plain lines."""

import io

import pytest

from rmr_deploy.screen import PlainScreen, RobotLine


@pytest.fixture
def output():
    return io.StringIO()


@pytest.fixture
def plain(output):
    return PlainScreen(output)


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
