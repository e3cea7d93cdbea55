"""The robot process: `rmr-agent --id 4 PROG.rbc` hosts one robot's mind behind real ports and a real clock."""

import rmr  # noqa: F401 - from then on compiled modules are found
