"""`rmr eval`: a program on robots without bodies, in virtual time, until nothing is left to do.

The robots are the nodes that a robot process hosts (rmr.node). What is particular to an evaluation stands here: who
is in radio range of whom (topology), the air between them (ether), what they are given (given), the run itself
(ensemble), and what is told of it (report). It prints nothing, waits for nothing and reads no clock: the command is
`rmr.commands.eval_command`.
"""
