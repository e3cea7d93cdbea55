"""A log is replayed to equal outputs; a changed, lost or damaged part of it is found and named."""

import pytest
from mind_runs import LABS, MindRun, body_of, replayed, resealed, with_changed_octet, without_call

from rmr.base.time import seconds
from rmr.mind import mind_format as form
from rmr.mind.mind_reader import MindLogError, read_batch
from rmr.mind.mind_replay import MindReplay
from rmr.node.trace import TraceLevel
from rmr.vm.engines import Engine

pytestmark = pytest.mark.medium


@pytest.fixture(scope="module")
def run():
    return MindRun(LABS / "corridor", 7)


@pytest.fixture(scope="module")
def log(run):
    return run.logs[3, 0]


# -- equal


@pytest.mark.parametrize("engine", list(Engine))
def test_replay_of_a_run_is_equal_with_either_engine(run, engine):
    for robot, epoch in run.logs:
        replay = run.replay(robot, epoch, engine=engine)
        assert replay.difference is None
        assert replay.ended
        assert replay.inputs > 4000
        assert replay.outputs > 900


SLOW_RECEIVER = """
order textual.
type log(robot, list int).
log(R, []).
count(@2, 5000).
count(R, N), N > 0 -o count(R, N - 1).
got(R, N), count(R, 0), log(R, L) -o count(R, 0), log(R, L + [N]).
go(@1).
go(R) -o got(@2, 1), got(@2, 2), got(@2, 3).
"""
SLOW_LAB = """
lab: slow
program: slow.rmr
seed: 1
duration: 2s
arena: {size: [1.5, 1.5], cell: 0.05}
robots: [{id: 1, pose: [0.2, 0.2, 0deg]}, {id: 2, pose: [0.6, 0.2, 0deg]}]
localisation: {beacons: [[0, 0], [1.5, 0]], rate: 10, sigma: 0.005}
"""


GRADIENT = """
type shared hops(robot, int).
hops(@1, 0).
hops(@2, 9).
hops(@3, 9).
hops(R, H), H > 0, N = min(X + 1, neighbor(R, B), hops(B, X)), H != N, N < 12 -o hops(R, N).
"""
GRADIENT_LAB = """
lab: gradient
program: gradient.rmr
seed: 1
duration: 20s
arena: {size: [1.5, 1.5], cell: 0.05}
robots: [{id: 1, pose: [0.2, 0.2, 0deg]}, {id: 2, pose: [0.6, 0.2, 0deg]}, {id: 3, pose: [1.0, 0.2, 0deg]}]
radio: {loss: 0.2}
localisation: {beacons: [[0, 0], [1.5, 0]], rate: 10, sigma: 0.005}
faults: [{from: 0s, to: 12s, link: [1, 3], cut: true}, {at: 8s, kill: 2}, {at: 15s, restart: 2}]
"""


@pytest.mark.parametrize("engine", list(Engine))
def test_what_is_heard_of_shared_facts_and_what_ends_unheard_is_replayed(tmp_path, engine):
    (tmp_path / "gradient.rmr").write_text(GRADIENT)
    (tmp_path / "lab.yaml").write_text(GRADIENT_LAB)
    run = MindRun(tmp_path / "lab.yaml")
    facts = {each.node.robot: each.node.machine.facts() for each in run.simulation.robots}
    assert facts == {1: ["hops(@1, 0)"], 2: ["hops(@2, 1)"], 3: ["hops(@3, 1)"]}
    for robot, epoch in run.logs:
        replay = run.replay(robot, epoch, engine=engine)
        assert replay.difference is None
        if (robot, epoch) != (2, 0):
            assert replay.node.machine.facts() == facts[robot]


def test_deliveries_that_wait_for_rules_take_effect_at_the_same_calls_with_either_engine(tmp_path):
    (tmp_path / "lab.yaml").write_text(SLOW_LAB)
    (tmp_path / "slow.rmr").write_text(SLOW_RECEIVER)
    run = MindRun(tmp_path)
    received = [entry for entry in run.simulation.trace() if entry["what"] == "received"]
    assert [entry["fact"] for entry in received] == [f"got(@2, {n})" for n in (1, 2, 3)]
    assert received[0]["t"] > 0.1, "ten batches of firings were before it"
    for engine in Engine:
        replay = run.replay(2, engine=engine)
        assert replay.difference is None
        assert "log(@2, [1, 2, 3])" in replay.node.machine.facts()


def test_replayed_node_ends_in_the_state_of_the_recorded_node(run):
    for robot in run.simulation.robots:
        twin = run.replay(robot.robot).node
        assert twin.machine.facts() == robot.node.machine.facts()
        assert twin.machine.goals() == robot.node.machine.goals()
        assert twin.finish_at == robot.node.finish_at
        assert twin.driver.localiser.pose == robot.node.driver.localiser.pose
        assert twin.crossings.schedules == robot.node.crossings.schedules


def test_recording_changes_nothing_of_the_run(run):
    from rmr_sim.run_setup import Options, load, report_of

    plain = load(LABS / "corridor", Options()).simulation(7)
    assert report_of(plain, plain.run()) == report_of(run.simulation, run.finished)
    assert plain.trace() == run.simulation.trace()


def test_replay_with_facts_traced_is_equal_and_has_the_notes_of_the_run(run):
    twin = run.replay(3, trace=TraceLevel.FACTS)
    assert twin.difference is None
    facts = [entry for entry in twin.node.trace_log if entry["what"] in ("inserted", "removed")]
    notes = [entry for entry in twin.node.trace_log if entry not in facts]
    assert notes == [entry for entry in run.simulation.trace() if entry["robot"] == 3]
    assert {"inserted", "removed"} == {entry["what"] for entry in facts}


def test_replay_stops_at_an_instant_and_goes_on_with_batches_that_are_fed(run, log):
    replay = MindReplay(log[:4], run.program)
    assert [at for at in replay.run(seconds(2)) if at > seconds(2)] == []
    assert seconds(1.9) < replay.now <= seconds(2)
    for _ in replay.run():
        pass
    assert replay.next_call is None
    assert seconds(2.9) < replay.now < seconds(3)  # the first batch is the header alone
    for data in log[4:]:
        replay.feed(data)
    for _ in replay.run():
        pass
    assert (replay.difference, replay.ended) == (None, True)


def test_a_log_costs_at_most_10_kilobytes_a_second(run):
    seconds_run = run.simulation.now / 1e9
    for log in run.logs.values():
        assert sum(map(len, log)) / seconds_run < 10_000


def test_a_log_holds_no_ground_truth(run, log):
    samples = [
        op.value for data in log for call in read_batch(data).calls for op in call.operations if op.kind == form.SENSED
    ]
    assert len(samples) > 100
    assert {sample.truth for several in samples for sample in several} == {(0.0, 0.0, 0.0)}


# -- changed logs


@pytest.mark.parametrize(
    ("kind", "place", "number"),
    [
        (form.OFFERED, 1 + 2 + 6, 40),  # signal strength
        (form.OFFERED, 1 + form.FRAME.size + 8, 40),  # payload of a hello
        (form.RECEIVED, 4 + form.FRAME.size + 4, 30),
        (form.CONFIRMED, 3, 0),  # handle of a request
        (form.SENSED, 3 + 8 + 5, 100),  # left wheel
        (form.SENSED, 3 + 16 + 5, 100),  # right wheel
        (form.SENSED, 3 + 24 + 4, 200),  # gyro
        (form.SENSED, 3 + 32 + 4, 300),  # compass
    ],
)
def test_one_changed_octet_of_an_input_is_found_within_a_second_and_named(run, kind, place, number):
    log = next(log for log in run.logs.values() if operations(log, kind) > number)
    changed, call = with_changed_octet(log, kind, place, number)
    difference = replayed(changed, run.program).difference
    assert difference is not None
    assert call.at <= difference.at <= call.at + seconds(1.1)
    assert difference.recorded != difference.replayed


def operations(log, kind):
    """Return how many operations of a kind a log has."""
    calls = [call for data in log for call in read_batch(data).calls]
    return sum(operation.kind == kind for call in calls for operation in call.operations)


@pytest.mark.parametrize("kind", [form.OVERHEAR, form.TICK])
@pytest.mark.parametrize("number", [3, 50, 200])
def test_one_dropped_call_is_found_within_a_second(run, log, kind, number):
    changed, call = without_call(log, kind, number)
    difference = replayed(changed, run.program).difference
    assert difference is not None
    assert call.at <= difference.at <= call.at + seconds(1.1)


def test_a_changed_wheel_command_is_named_with_both_values(run, log):
    changed, call = with_changed_octet(log, form.ACT, 1 + 6, 20)
    difference = replayed(changed, run.program).difference
    assert (difference.at, difference.what) == (call.at, "wheel command")
    assert " m/s, " in difference.recorded
    assert " m/s, " in difference.replayed


def test_a_changed_transmission_is_named_with_both_payloads(run, log):
    changed, call = with_changed_octet(log, form.TRANSMIT, form.TRANSMIT_HEAD.size + 1, 5)
    difference = replayed(changed, run.program).difference
    assert (difference.at, difference.what) == (call.at, "frame sent")
    assert difference.recorded.startswith(difference.replayed.split(":")[0])


def test_differences_before_the_first_instant_are_ignored(run, log):
    changed, call = with_changed_octet(log, form.TRANSMIT, form.TRANSMIT_HEAD.size + 1, 5)
    replay = replayed(changed, run.program, since=call.at + seconds(2))
    assert replay.difference is None
    assert replay.began >= call.at + seconds(2)


# -- damaged logs


def test_a_batch_with_a_flipped_bit_is_damaged(run, log):
    data = bytearray(log[5])
    data[len(data) // 2] ^= 1
    with pytest.raises(MindLogError, match="batch 5 of the log is damaged: its check sum differs"):
        replayed([*log[:5], bytes(data), *log[6:]], run.program)


def test_a_missing_batch_is_told(run, log):
    with pytest.raises(MindLogError, match="batch 5 of its log is missing"):
        replayed([*log[:5], *log[6:]], run.program)
    with pytest.raises(MindLogError, match="batches 5 to 6 of its log are missing"):
        replayed([*log[:5], *log[7:]], run.program)


def test_a_log_without_its_beginning_cannot_be_replayed(run, log):
    with pytest.raises(MindLogError, match="its beginning is missing"):
        MindReplay(log[1:], run.program)
    with pytest.raises(MindLogError, match="its beginning is missing"):
        MindReplay([], run.program)


@pytest.mark.parametrize("octets", [0, 10, 20])
def test_a_batch_cut_short_is_told(log, octets):
    with pytest.raises(MindLogError, match="cut short"):
        read_batch(log[0][:octets])


def test_octets_of_something_else_are_told(log):
    with pytest.raises(MindLogError, match="does not begin as one does"):
        read_batch(b"PK" + log[0][2:])
    with pytest.raises(MindLogError, match="format 9"):
        read_batch(log[0][:2] + b"\x09" + log[0][3:])


def test_operations_that_are_none_are_malformed(log):
    for body in (b"\xff", b"\x02\x00", bytes([form.ACT]), body_of(log[3]) + bytes([form.RECEIVED])):
        with pytest.raises(MindLogError, match="malformed"):
            read_batch(resealed(log[3], body))


def test_a_log_that_was_cut_off_has_not_ended(run, log):
    replay = replayed(log[:-1], run.program)
    assert (replay.difference, replay.ended) == (None, False)


def test_an_exception_of_the_replay_alone_is_a_difference(run, log):
    replay = MindReplay(log, run.program)
    for _ in replay.run(seconds(5)):
        pass
    replay.node.driver.navigator = None
    for _ in replay.run():
        pass
    assert replay.difference.at > seconds(5)
    assert "AttributeError: 'NoneType' object has no attribute" in replay.difference.replayed
