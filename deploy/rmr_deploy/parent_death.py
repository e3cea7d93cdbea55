"""Runs a command that the kernel kills when its parent ends: `python -m rmr_deploy.parent_death PARENT COMMAND...`.

For processes that are started while the parent has other threads: code between fork and exec is not safe then, so the
kernel is asked here, after the first exec (prctl(2), PR_SET_PDEATHSIG, is kept by the second).
"""

import ctypes
import os
import signal
import sys

from rmr.entry import ExitCode

PR_SET_PDEATHSIG = 1
"""Option of prctl(2), from linux/prctl.h."""


def main() -> None:
    """Ask the kernel, and become the command."""
    parent = int(sys.argv[1])
    command = sys.argv[2:]
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL))
    if os.getppid() != parent:  # it died before the kernel was asked
        sys.exit(ExitCode.FAILED)
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
