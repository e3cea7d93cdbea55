"""`rmr why ID FACT` on a lab that runs as processes: the answer comes from what they have recorded so far."""

import json
import shutil

import pytest
from command_runner import invoke
from launched import CORRIDOR, eventually

from rmr_deploy.why_program import why_command


@pytest.mark.slow
def test_why_of_a_fact_is_answered_while_the_processes_run(up, tmp_path, monkeypatch):
    monkeypatch.setenv("RMR_REGISTER", str(tmp_path / "register"))  # another test may run a lab
    (tmp_path / "runs").mkdir()
    lab = tmp_path / "corridor"
    shutil.copytree(CORRIDOR, lab)
    # Without a finish the run lasts until it is interrupted, however slow the machine.
    lab_file = lab / "lab.yaml"
    lab_file.write_text(lab_file.read_text().replace("finish: at(R, exit)\n", ""))
    run = up(lab, "--robots", "2", "--run", str(tmp_path / "runs" / "corridor-1")).running()
    monkeypatch.chdir(tmp_path)

    def asked(*words):
        return invoke(why_command(), words, name="rmr why")

    def known():
        answer = asked("1", "crossing(R, _)")
        assert run.process.poll() is None, run.out + run.err
        return answer if "by rule" in answer.stdout else None

    text = eventually(known).stdout
    assert "crossing(@1, 32.0)" in text
    assert "by rule corridor.rmr:15" in text
    assert "the recording has not been finished: robot 1 is known until " in text
    found = json.loads(asked("1", "crossing(R, _)", "--json").stdout)
    [answer] = found["answers"]
    assert (answer["robot"], answer["cause"], answer["rule"]["line"]) == (1, "rule", 15)
    assert {child["cause"] for child in answer["children"]} <= {"given", "rule", "sensed"}
    absent = asked("1", "at(@1, exit)", "--not")
    assert absent.exit_code == 0
    assert "at(@1, exit) does not hold at " in absent.stdout
    assert run.process.poll() is None
    run.interrupt()
    run.wait()
