"""Robots that run signed programs alone: what they are started with, loaded with over bus and radio, and go on with."""

import json

import pytest
from command_runner import invoke
from process_tools import Stage

from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.signing import signed_by
from rmr.bytecode import codec
from rmr.bytecode.layout import Signed
from rmr.lang.compiler import compile_source
from rmr.mind.mind_versions import is_compiled
from rmr_agent.state_files import PROGRAM
from rmr_agent.take_snapshot import main as take_snapshot
from rmr_deploy.load import command

pytestmark = pytest.mark.slow

NEW = "type !due(robot, float).\ntype note(robot, int).\nnote(R, {number}).\n"
ANN = holder("operator", "ann")


class SignedStage:
    """A stage, a CA whose certificate its robots trust, and two operators."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "stage").mkdir()
        self.stage = Stage(folder / "stage")
        self.ca = Authority.begin(folder / "ca")
        other = Authority.begin(folder / "other")
        for authority, name in ((self.ca, "ann"), (other, "eve")):
            authority.issue(holder("operator", name))
            write_bundle(authority.bundle(holder("operator", name)), folder / name)
        (folder / "trust").mkdir()
        self.trust = folder / "trust" / "ca.pem"
        self.trust.write_bytes((self.ca.folder / "ca.pem").read_bytes())
        self.program("idle", None, (self.stage.folder / "idle.rbc").read_bytes())
        self.program("own", "ann", (self.stage.folder / "idle.rbc").read_bytes())
        for number, by in enumerate((None, "ann", "eve")):
            octets = codec.encode(compile_source(NEW.format(number=number)).program, debug=False)
            self.program(f"by-{by}", by, octets)

    def program(self, name, by, octets):
        """Write a program, signed by the keys in the folder `by`."""
        signature = () if by is None else signed_by(self.folder / by, octets)
        (self.stage.folder / f"{name}.rbc").write_bytes(Signed(octets, *signature).joined())

    def robot(self, robot, *options, program="own.rbc"):
        return self.stage.agent(robot, "--trust", self.trust, *options, program=program)

    def load(self, program, *words):
        """Load a program; return the exit code and the outcome."""
        words = [str(self.stage.folder / program), *words, "--json", "--connect", self.stage.endpoint]
        answer = invoke(command(), words, name="rmr load")
        return answer.exit_code, json.loads(answer.stdout)

    def facts_are(self, **wanted):
        """Wait until the robots report these facts."""
        numbers = {int(name.removeprefix("robot")): facts for name, facts in wanted.items()}
        self.stage.statuses(
            lambda newest: all(
                robot in newest and list(newest[robot].report.get("facts", ())) == facts
                for robot, facts in numbers.items()
            )
        )


@pytest.fixture
def lab(tmp_path):
    lab = SignedStage(tmp_path)
    yield lab
    lab.stage.end()
    assert not any("Traceback" in started.said() for started in lab.stage.started)


OWN = {"robot1": ["!due(@1, 25.0)"], "robot2": []}


def test_a_robot_with_trust_is_not_started_with_what_it_does_not_trust(lab):
    for program, says in (
        ("idle.rbc", "idle.rbc: it is not signed, as all programs of this robot must be: rmr sign PROG.rbc --keys DIR"),
        ("by-eve.rbc", f"by-eve.rbc: its signer is of another CA than {lab.trust}: sign it with an operator's keys"),
    ):
        robot = lab.robot(1, program=program)
        assert robot.exit_code() == 3
        assert says in robot.said()
    nothing = lab.stage.agent(1, "--trust", lab.folder / "none.pem", program="own.rbc")
    assert nothing.exit_code() == 2
    assert "none.pem: No such file or directory" in nothing.said()
    leaf = lab.stage.agent(1, "--trust", lab.folder / "ann" / "cert.pem", program="own.rbc")
    assert leaf.exit_code() == 3
    assert "cert.pem: no certificate of a CA; --trust names ca.pem" in leaf.said()


@pytest.mark.parametrize("via", ["bus", "radio"])
def test_a_load_that_one_robot_does_not_trust_is_told_and_no_robot_switches(lab, via):
    """The other one trusts everybody: not even it runs the new program."""
    lab.stage.world()
    lab.stage.agent(1)
    second = lab.robot(2)
    lab.facts_are(**OWN)
    for program, says in (
        ("by-None.rbc", "it is not signed, as all programs of this robot must be"),
        ("by-eve.rbc", "its signer is of another CA than "),
    ):
        code, told = lab.load(program, "--via", via)
        assert (code, told["switched"]) == (1, False)
        assert told["robots"]["1"]["problem"] is None
        assert told["robots"]["2"]["problem"].startswith(says)
        second.wait_for(f"refuses to be loaded with program {told['program']}: {says}")
    lab.facts_are(**OWN)
    code, told = lab.load("by-ann.rbc", "--via", via)
    assert (code, told["switched"]) == (0, True)
    lab.facts_are(robot1=["!due(@1, 25.0)", "note(@1, 1)"], robot2=["note(@2, 1)"])


def test_a_robot_that_was_away_takes_no_newer_program_from_others_that_it_does_not_trust(lab):
    lab.stage.world()
    lab.stage.agent(1)
    away = lab.stage.agent(2)
    lab.facts_are(**OWN)
    assert lab.load("by-eve.rbc")[0] == 0
    away.end()
    again = lab.robot(2)
    again.wait_for("refuses to be loaded with program")
    assert "its signer is of another CA than " in again.said()
    lab.facts_are(robot1=["!due(@1, 25.0)", "note(@1, 2)"], robot2=[])


def test_a_robot_that_waits_for_its_first_program_begins_with_a_signed_one(lab):
    lab.stage.world()
    lab.robot(1)
    waits = lab.robot(2, program=None)
    waits.wait_for("waits for a program")
    lab.stage.statuses(lambda newest: 1 in newest and "facts" in newest[1].report)
    assert lab.load("by-None.rbc", "--robots", "2")[0] == 1
    assert lab.load("by-ann.rbc", "--robots", "2")[0] == 0
    lab.facts_are(robot2=["note(@2, 1)"])


def test_a_durable_robot_does_not_go_on_with_a_program_whose_signer_was_revoked(lab):
    lab.stage.world()
    lab.robot(1)
    state = lab.folder / "state"
    robot = lab.robot(2, "--state", state)
    lab.facts_are(**OWN)
    assert (state / PROGRAM).read_bytes() == (lab.stage.folder / "own.rbc").read_bytes()
    robot.end()
    lab.ca.revoke(ANN)
    (lab.trust.parent / "revoked.txt").write_text("operator/ann\n")
    kept = {path.name: path.read_bytes() for path in state.iterdir()}
    refused = lab.robot(2, "--state", state)
    assert refused.exit_code() == 3
    assert "own.rbc: its signer operator/ann is revoked: have it signed by another operator" in refused.said()
    assert {path.name: path.read_bytes() for path in state.iterdir()} == kept
    lab.ca.issue(ANN)
    write_bundle(lab.ca.bundle(ANN), lab.folder / "again")
    lab.program("own", "again", (lab.stage.folder / "idle.rbc").read_bytes())
    lab.robot(2, "--state", state).wait_for("and goes on as it was at")


@pytest.mark.skipif(is_compiled(), reason="where rmr is compiled there are no snapshots")
def test_no_snapshot_is_taken_with_a_stored_program_that_is_not_trusted(lab, monkeypatch, capsys):
    """It is the same program by its digest, which a signature is no part of."""
    lab.stage.world()
    state, key = lab.folder / "state", lab.folder / "state.key"
    robot = lab.robot(2, "--state", state, "--state-key", key, "--snapshots", "0")
    lab.robot(1)
    lab.facts_are(**OWN)
    robot.end()
    monkeypatch.setattr("os.nice", lambda _: 0)
    monkeypatch.setattr("sys.argv", ["take", str(state), "1", str(key), str(lab.trust)])
    assert take_snapshot() == 0
    (state / "snapshot-1").unlink()
    (state / PROGRAM).write_bytes((lab.stage.folder / "idle.rbc").read_bytes())
    assert take_snapshot() == 1
    assert "program.rbc: it is not signed, as all programs of this robot must be" in capsys.readouterr().err
    assert not (state / "snapshot-1").exists()
