"""What the world records: scene, floor, poses while robots move, disturbances."""

from pathlib import Path

from rmr.base.geometry import Pose
from rmr.bus.process_recorder import ProcessRecorder
from rmr.radio.links import Disturbance
from rmr.record.recording import open_recording
from rmr_world.lab_file import load_lab
from rmr_world.world_messages import WorldRecorder

LAB = Path(__file__).parents[3] / "deploy" / "labs" / "corridor"
TENTH = 10**8


def test_the_world_records_scene_poses_and_disturbances(tmp_path):
    lab = load_lab(LAB)
    recorder = ProcessRecorder(tmp_path / "world.mcap", "world")
    world = WorldRecorder(recorder, lab, lab.seed, lambda: 1)
    world.begin(lambda: 0, [(1, Pose(0.0, 0.0, 0.0))])
    world.poses(TENTH, [(1, Pose(0.0, 0.0, 0.0))])
    world.poses(2 * TENTH, [(1, Pose(0.5, 0.0, 0.0))])
    world.poses(12 * TENTH, [(1, Pose(0.5, 0.0, 0.0))])
    world.added(3 * TENTH, Disturbance(since=3 * TENTH, until=5 * TENTH, loss=0.5))
    recorder.end()
    with open_recording(tmp_path / "world.mcap") as recording:
        messages = [message for message in recording.messages() if message.topic != "/log"]
    assert [(message.topic, message.at) for message in messages] == [
        ("/scene", 0),
        ("/floor", 0),
        ("/tf", 0),
        ("/tf", 2 * TENTH),
        ("/faults", 3 * TENTH),
        ("/tf", 12 * TENTH),
    ]
    assert messages[4].data == {"fault": {"from": 0.3, "to": 0.5, "loss": 0.5}}


def test_without_a_recorder_nothing_is_recorded(tmp_path):
    lab = load_lab(LAB)
    world = WorldRecorder(None, lab, lab.seed, lambda: 1)
    world.begin(lambda: 0, [])
    world.poses(0, [(1, Pose(0.0, 0.0, 0.0))])
    world.fault(0, {})
    assert list(tmp_path.iterdir()) == []
