"""What a robot process takes for byte-code."""

import os

import pytest

from rmr.bytecode.codec import encode
from rmr.bytecode.layout import SIZE_MAX
from rmr.lang.compiler import compile_source
from rmr_agent.bytecode import RefusedError, load_program


def test_a_robot_reads_programs_as_large_as_the_compiler_writes(tmp_path):
    facts = "".join(f'p(@1, "{number:0>1000}").\n' for number in range(1500))
    octets = encode(compile_source(facts).program, debug=False)
    assert 1 << 20 < len(octets) <= SIZE_MAX
    (tmp_path / "large.rbc").write_bytes(octets)
    assert len(load_program(tmp_path / "large.rbc").program.facts) == 1500


def test_read_of_byte_code_file_stops_at_the_size_bound(tmp_path):
    path = tmp_path / "endless.rbc"
    path.write_bytes(encode(compile_source("p(@1).").program, debug=False))
    os.truncate(path, 1 << 34)
    with pytest.raises(RefusedError, match=f"at most {SIZE_MAX}"):
        load_program(path)
