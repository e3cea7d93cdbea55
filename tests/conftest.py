"""Makes the helpers that stand in this folder (`vm_hand`) importable from every test."""

import signal

from hypothesis import settings

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A suite that runs in a shell's background is started with SIGINT ignored, and so would be every process it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples in every run, so that only a change makes a test fail; campaigns over seeds run outside the suite.
settings.register_profile("suite", derandomize=True, print_blob=True)
settings.load_profile("suite")
