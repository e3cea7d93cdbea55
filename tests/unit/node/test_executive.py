"""The executive runs its tasks in priority order, frame by frame, and counts what it must leave out (paper V.B.3)."""

from rmr.base.time import milliseconds, tick_start
from rmr.node.executive import Executive, ExecutiveTask


class Bench:
    def __init__(self, costs_ms: dict[str, int], phase: int = 0) -> None:
        self.ran: list[str] = []
        self.spent = 0
        self.costs = costs_ms
        self.executive = Executive(
            [
                ExecutiveTask("motor", self._task("motor"), periodic=True),
                ExecutiveTask("radio", self._task("radio"), periodic=False),
                ExecutiveTask("telemetry", self._task("telemetry"), periodic=True),
            ],
            lambda: self.spent,
            phase,
        )

    def _task(self, name: str):
        def run(now: int) -> None:
            self.ran.append(name)
            self.spent += milliseconds(self.costs.get(name, 0))

        return run

    def tick(self, now: int) -> list[str]:
        self.spent = 0
        self.ran = []
        self.executive.tick(now)
        return self.ran


def test_tasks_run_in_the_order_of_their_priority_once_a_frame():
    bench = Bench({})
    assert bench.tick(tick_start(1)) == ["motor", "radio", "telemetry"]
    assert bench.tick(tick_start(1) + 5) == ["radio"], "between frames only what reacts to input"
    assert bench.tick(tick_start(2)) == ["motor", "radio", "telemetry"]


def test_what_does_not_fit_is_left_out_lowest_priority_first_and_counted():
    bench = Bench({"motor": 10, "radio": 10})
    assert bench.tick(tick_start(1)) == ["motor", "radio"]
    assert bench.executive.skipped == 1
    bench.costs = {}
    assert bench.tick(tick_start(2)) == ["motor", "radio", "telemetry"], "the next frame begins anew"


def test_frames_that_the_host_lets_pass_are_counted_only_while_the_robot_is_busy():
    bench = Bench({})
    bench.tick(tick_start(1))
    assert bench.executive.next_frame(busy=True) == tick_start(2)
    bench.tick(tick_start(4))
    assert bench.executive.frames_late == 2
    assert bench.executive.next_frame(busy=False) is None
    bench.tick(tick_start(60))
    assert bench.executive.frames_late == 2


def test_frames_with_a_phase_are_as_long_as_the_labs_and_begin_so_much_later():
    phase = milliseconds(5)
    bench = Bench({}, phase)
    assert bench.tick(0) == ["motor", "radio", "telemetry"], "the first call begins a frame, whenever it comes"
    assert bench.tick(phase - 1) == ["radio"]
    assert bench.tick(phase) == ["motor", "radio", "telemetry"]
    assert bench.executive.next_frame(busy=True) == tick_start(1) + phase
    bench.tick(tick_start(2) + phase - 1)
    assert bench.executive.frames_late == 0, "within the frame is in time"
    assert bench.executive.next_frame(busy=True) == tick_start(2) + phase
    bench.tick(tick_start(3) + phase)
    assert bench.executive.frames_late == 1
