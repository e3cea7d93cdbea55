"""A robot that was stopped has no record of its end but that of its log: from then on it is gone."""

import pytest

from rmr.base.time import NEVER, seconds
from rmr.lang.compiler import compile_source
from rmr.why.history_listener import HistoryListener
from rmr.why.mind_index import MindIndex
from rmr.why.replayed_histories import end_early


@pytest.mark.parametrize("in_order", [False, True])
@pytest.mark.parametrize(
    ("last_s", "gone"),
    [(3, [(seconds(3), NEVER)]), (39, [])],  # the last of those that are stopped with the run
)
def test_a_robot_whose_log_ends_long_before_the_run_is_gone_from_then_on(last_s, gone, in_order):
    program = compile_source("type at(robot, symbol).").program
    listener = HistoryListener(1, program)
    listener.history.minds.append(MindIndex(1, 0, program))
    listener.history.ends = seconds(last_s)
    end_early(listener, seconds(40), in_order=in_order)
    assert listener.history.absences(stopped=in_order) == gone
    assert listener.history.absences(stopped=not in_order) == []
