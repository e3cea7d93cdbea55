"""`rmr up --watch`: a saved program is compiled and loaded onto the running robots."""

import json
import shutil
import signal

import pytest
from launched import CORRIDOR, eventually

OLD = "waiting(R), moveto(R, exit)"
NEW = "passing(R), waiting(R), moveto(R, exit)"


@pytest.mark.slow
def test_a_program_that_is_saved_is_loaded_and_one_with_errors_is_not(up, tmp_path):
    lab = tmp_path / "lab"
    shutil.copytree(CORRIDOR, lab)
    program = lab / "corridor.rmr"
    source = program.read_text()
    # Without a finish the run lasts until it is interrupted, however slow the machine.
    lab_file = lab / "lab.yaml"
    lab_file.write_text(lab_file.read_text().replace("finish: at(R, exit)\n", ""))
    launched = up(lab, "--robots", "2", "--watch", "--no-view", "--no-record").running()

    def told(text):
        eventually(lambda: text in launched.out + launched.err, 60.0)

    told("for changes of the program")
    program.write_text(source.replace("lineup(R, entry, K).", "lineup(R, entry, K"))
    told("corridor.rmr is not loaded:")
    program.write_text(source.replace(OLD, NEW))
    told("2 robots run program")
    launched.process.send_signal(signal.SIGINT)
    launched.process.wait(60.0)
    assert json.loads((launched.folder / "report.json").read_text())["robots"]["2"]["assertions"]
    assert launched.left() == []
