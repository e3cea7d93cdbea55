"""`rmr config`: a lab as data, with all that its file leaves to defaults."""

import json
from pathlib import Path

from rmr_deploy.resolved_lab import resolved_lab
from rmr_world.lab_file import load_lab

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "ros2" / "mixed.yaml"


def test_bodies_have_the_names_of_their_topics():
    lab = json.loads(json.dumps(resolved_lab(load_lab(EXAMPLE))))
    assert [body["robot"] for body in lab["bodies"]] == [4, 5, 6]
    assert lab["bodies"][0]["cmd_vel"] == "/tb3_4/cmd_vel"
    assert len(lab["bodies"][0]["origin"]) == 3


def test_facts_from_topics_stand_beside_those_of_the_start(tmp_path):
    entry = {"topic": "battery", "type": "sensor_msgs/BatteryState", "fact": "charge(R, percentage)"}
    text = EXAMPLE.with_name("metre.yaml").read_text() + f"facts: ['due(@4, 3)', {json.dumps(entry)}]\n"
    (tmp_path / "lab.yaml").write_text(text)
    lab = json.loads(json.dumps(resolved_lab(load_lab(tmp_path / "lab.yaml"))))
    assert lab["facts"] == ["due(@4, 3)", entry | {"every_s": 1.0}]
