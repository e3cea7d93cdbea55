"""The robot process: `rmr-agent --id 4 PROG.rbc` hosts one robot's mind behind real ports and a real clock."""
