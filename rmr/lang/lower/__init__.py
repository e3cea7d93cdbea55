"""The last phase: a checked program of the ensemble to the byte-code program of one robot.

Projection to the home robot, the order of conditions, the program's tables, and what is worked out on the finished
program: which rules lead to which goals, and which actions serve which time assertions.
"""
