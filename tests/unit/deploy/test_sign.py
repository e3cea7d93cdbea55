"""`rmr sign`, and the files that robots read: with a signature, without one, and cut off."""

import pytest
from command_runner import invoke

from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.signing import read_trust
from rmr.bytecode import codec
from rmr.bytecode.disassemble import OCTETS_SHOWN, disassemble
from rmr.bytecode.layout import split
from rmr.lang.compiler import compile_source
from rmr_agent.bytecode import RefusedError, load_program
from rmr_deploy import sign
from rmr_deploy.sign import command, signed


def byte_code(number):
    return codec.encode(compile_source(f"p(@1, {number}).").program, debug=True)


@pytest.fixture
def place(tmp_path):
    """Return a folder with a CA, keys of ann and robot 1, and two programs."""
    ca = Authority.begin(tmp_path / "ca")
    for who in (holder("operator", "ann"), holder("robot", "1")):
        ca.issue(who)
        write_bundle(ca.bundle(who), tmp_path / who.name)
    for number in (1, 2):
        (tmp_path / f"p{number}.rbc").write_bytes(byte_code(number))
    return tmp_path


def call(*words):
    return invoke(command(), list(words), name="rmr sign", catch_exceptions=False)


def test_a_signed_program_is_taken_with_trust_and_is_the_same_program_without(place):
    plain = load_program(place / "p1.rbc")
    answer = call(place / "p1.rbc", "--keys", place / "ann")
    assert answer.exit_code == 0, answer.output
    assert f"program {plain.digest:08x}, signed by operator/ann; robots take it until 20" in answer.stdout
    assert (place / "p1.rbc").read_bytes().startswith(plain.octets)
    for trust in (None, read_trust(place / "1")):
        loaded = load_program(place / "p1.rbc", trust)
        assert (loaded.digest, loaded.program) == (plain.digest, plain.program)


def test_without_a_signature_robots_with_trust_refuse_it_and_say_how_to_sign(place):
    with pytest.raises(RefusedError, match=r"p1\.rbc: it is not signed, .* rmr sign PROG\.rbc --keys DIR"):
        load_program(place / "p1.rbc", read_trust(place / "1"))


def test_the_signature_of_another_program_is_refused(place):
    call(place / "p1.rbc", "--keys", place / "ann")
    first = split((place / "p1.rbc").read_bytes())
    (place / "p2.rbc").write_bytes(first._replace(program=(place / "p2.rbc").read_bytes()).joined())
    assert load_program(place / "p2.rbc").program.facts  # a robot without trust does not judge it
    with pytest.raises(RefusedError, match=r"its signature by operator/ann is of another program"):
        load_program(place / "p2.rbc", read_trust(place / "1"))


def test_a_file_that_is_cut_off_anywhere_is_refused_by_all(place):
    call(place / "p1.rbc", "--keys", place / "ann")
    octets = (place / "p1.rbc").read_bytes()
    plain = len(split(octets).program)
    for length in [*range(0, plain, 7), *range(plain + 1, len(octets), 5), len(octets) - 1]:
        (place / "cut.rbc").write_bytes(octets[:length])
        with pytest.raises(RefusedError, match=r"truncated|not RMR byte-code"):
            load_program(place / "cut.rbc")
    (place / "cut.rbc").write_bytes(octets[:plain])  # nothing is left of the signature
    load_program(place / "cut.rbc")
    with pytest.raises(RefusedError, match="it is not signed"):
        load_program(place / "cut.rbc", read_trust(place / "1"))
    for more in (b"x", octets[plain:]):
        (place / "cut.rbc").write_bytes(octets + more)
        with pytest.raises(RefusedError, match="malformed signature"):
            load_program(place / "cut.rbc")


def test_signing_again_replaces_the_signature_and_a_load_leaves_one_that_is_there(place):
    call(place / "p1.rbc", "--keys", place / "ann")
    once = (place / "p1.rbc").read_bytes()
    assert signed(once, place / "ann") == once
    assert call(place / "p1.rbc", "--keys", place / "ann", "-o", place / "again.rbc").exit_code == 0
    again = (place / "again.rbc").read_bytes()
    assert split(again).program == split(once).program
    assert again != once
    assert load_program(place / "again.rbc", read_trust(place / "1"))


def test_a_secret_signs_nothing(place):
    (place / "secret").write_text("rmr:" + "a" * 32)
    assert signed(byte_code(1), place / "secret") == signed(byte_code(1), None) == byte_code(1)


def test_the_text_of_byte_code_shows_every_octet_of_a_signature(place):
    call(place / "p1.rbc", "--keys", place / "ann")
    octets = (place / "p1.rbc").read_bytes()
    text = disassemble(octets)
    found = split(octets)
    sizes = f"a certificate of {len(found.certificate)} octets, a signature of {len(found.signature)}"
    behind = text.partition(f"; signed: {sizes}\n")[2]
    shown = b"".join(bytes.fromhex(line[8:][: 3 * OCTETS_SHOWN].strip()) for line in behind.splitlines())
    assert shown == octets[len(found.program) :]
    assert disassemble(found.program) == text.partition("; signed:")[0]


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["p1.rbc"], 2, "name the folder with an operator's keys with --keys DIR"),
        (["none.rbc", "--keys", "ann"], 2, "none.rbc: No such file or directory"),
        (["p1.rbc", "--keys", "nowhere"], 2, "--keys: there is no folder nowhere"),
        (["p1.rbc", "--keys", "1"], 3, "the keys of robot/1, where those of operator are needed"),
        (["p1.rbc", "--keys", "ca"], 3, "this is the folder of a CA; give a process its own"),
        (["source.rmr", "--keys", "ann"], 3, "source.rmr: not RMR byte-code (it does not begin with the magic"),
        (["source.rmr", "--keys", "ann"], 3, "; compile it first: rmrc PROG.rmr"),
        (["p1.rbc", "--keys", "ann", "-o", "nowhere/x.rbc"], 2, "nowhere/x.rbc: No such file or directory"),
    ],
)
def test_what_cannot_be_signed_is_one_sentence_and_the_file_stays(place, monkeypatch, words, code, says):
    monkeypatch.chdir(place)
    (place / "source.rmr").write_text("p(@1, 1).\n")
    answer = call(*words)
    assert (answer.exit_code, answer.stdout) == (code, "")
    assert says in answer.stderr.splitlines()[0]
    assert (place / "p1.rbc").read_bytes() == byte_code(1)
    assert not list(place.glob(".*.new"))


def test_a_program_that_no_robot_could_read_with_its_signature_is_refused(place, monkeypatch):
    monkeypatch.setattr("rmr.bytecode.layout.SIZE_MAX", len(byte_code(1)) + 100)
    answer = call(place / "p1.rbc", "--keys", place / "ann")
    assert answer.exit_code == 3
    assert "octets with its signature, at most" in answer.stderr


def test_keys_may_stand_in_the_environment(place, monkeypatch):
    monkeypatch.setenv("RMR_KEYS", str(place / "ann"))
    assert call(place / "p1.rbc").exit_code == 0
    assert sign.signed((place / "p1.rbc").read_bytes(), None) == (place / "p1.rbc").read_bytes()
