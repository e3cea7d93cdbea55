"""`rmr eval`: a program on robots without bodies, in virtual time, until nothing is left to do.

The robots are the nodes that a robot process hosts (rmr.node). This package has what is particular to an evaluation:
which robots are in range of each other (topology), the air between them (eval_ether), facts from outside (given), the
run itself (ensemble), and the report (eval_report). It prints nothing, waits for nothing and reads no clock. The
command is `rmr.commands.eval_command`.
"""
