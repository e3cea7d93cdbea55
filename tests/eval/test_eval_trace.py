"""What `rmr eval --trace FILE` writes."""

import json

from rmr.node.trace import EVENTS

TELL = """type done(robot, robot).
tell(@1).
tell(A) -o told(@2, A).
told(B, A) -o done(A, B).
x: watch(tell(R), done(R, B), 5, stop(R)).
"""


def of(notes, *what):
    return [note for note in notes if note["what"] in what]


def test_every_firing_stands_there_with_the_place_of_its_rule(bench):
    notes = bench.notes(TELL, "--robots", "2")
    path = bench.folder / "p.rmr"
    assert of(notes, "fired") == [
        {"t": 0.0, "robot": 1, "what": "fired", "rule": f"{path}:3"},
        {"t": 0.005, "robot": 2, "what": "fired", "rule": f"{path}:4"},
    ]


def test_no_firing_is_left_out_however_many_there_are(bench):
    notes = bench.notes("a(R, 0). a(R, N), N < 2000 -o a(R, N + 1).")
    assert len(of(notes, "fired")) == 2000


def test_every_message_stands_there_with_its_fate(bench):
    notes = bench.notes(TELL, "--robots", "2")
    assert [(note["what"], note["robot"]) for note in of(notes, "sent", "received", "delivered")] == [
        ("sent", 1),
        ("received", 2),
        ("sent", 2),
        ("delivered", 1),
        ("received", 1),
        ("delivered", 2),
    ]
    assert of(notes, "sent")[0] == {"t": 0.0, "robot": 1, "what": "sent", "destination": 2, "fact": "told(@2, @1)"}


def test_so_do_those_that_were_lost_and_repeated(bench):
    notes = bench.notes(TELL, "--robots", "2", "--loss", "0.5", "--seed", "3")
    report = bench.run(TELL, "--robots", "2", "--loss", "0.5", "--seed", "3")
    lost = of(notes, "lost")
    assert {note["frame"] for note in lost} == {"fact", "acknowledgement"}
    assert len([note for note in lost if note["frame"] == "fact"]) == report["messages"]["lost"]
    assert len(of(notes, "repeated")) == report["messages"]["repeated"] > 0


def test_every_assertion_stands_there_from_its_start_to_its_end(bench):
    jobs = of(bench.notes(TELL, "--robots", "2"), "job_started", "job_finished", "deadline_missed")
    assert [(note["t"], note["what"], note["job"]) for note in jobs] == [
        (0.0, "job_started", "done(@1, _)"),
        (0.01, "job_finished", "done(@1, _)"),
    ]
    assert jobs[0]["deadline_s"] == 5.0
    missed = of(bench.notes(TELL.replace("told(B, A) -o", "told(B, A), A = B -o"), "--robots", "2"), "deadline_missed")
    assert [note["t"] for note in missed] == [5.0]


def test_notes_are_objects_on_lines_of_the_known_vocabulary_in_order_of_time(bench):
    notes = bench.notes(TELL, "--robots", "2", "--loss", "0.3", "--insert", "1s: tell(@1)")
    assert [note["t"] for note in notes] == sorted(note["t"] for note in notes)
    for note in notes:
        assert list(note)[:3] == ["t", "robot", "what"]
        assert note["what"] in (*EVENTS, "lost")
    assert all(json.dumps(note) for note in notes)


def test_a_trace_that_cannot_be_written_is_wrong_usage(bench):
    said = bench.refused("p(R).", "--trace", str(bench.folder / "no" / "t.jsonl"))
    assert "cannot write" in said
    assert "No such file or directory" in said
    assert "cannot write" in bench.refused("p(R).", "--trace", str(bench.folder))


def test_what_is_to_be_run_is_never_overwritten(bench):
    more = bench.file("more.rmr", "p(@1).")
    for target in ("p.rmr", "more.rmr"):
        said = bench.refused("p(R) -o q(R).", "--facts", more, "--trace", str(bench.folder / target))
        assert "is what is to be run" in said
    assert (bench.folder / "more.rmr").read_text() == "p(@1)."
