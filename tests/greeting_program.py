"""A small program for tests of the radio: robot 1 tells each other robot something longer than a frame."""

PROGRAM = """
type action goto(robot, float, float).
type start(robot).
type hello(robot, robot, string).
type !greeted(robot, robot).
start(@1).
greeted(@1, @1).
start(A) -o {B | peer(A, B) | hello(B, A, "WORDS")}.
hello(R, A, S) -o greeted(R, A).
""".replace("WORDS", "word " * 60)
