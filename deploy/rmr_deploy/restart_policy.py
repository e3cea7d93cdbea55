"""The restart policy of `rmr up`: whether, and how soon, the process of a robot that has failed is started again.

As in compose, ``on-failure`` is for processes that end by themselves with another exit code than 0, or by a signal.
What a person has killed or stopped stays down. The pause before each start doubles, and begins anew after a process
has run for a while: a robot that fails at once takes no processor time from the others.
"""

import re
from dataclasses import dataclass

from rmr.entry import ExitCode

FIRST_PAUSE_S = 0.1
PAUSE_S_MAX = 10.0
STEADY_S = 10.0
"""A process that has run for so long is no sign that the next one will fail at once."""

POLICY = re.compile(r"on-failure(?::([1-9][0-9]{0,5}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """When a robot is started again."""

    times: int | None = None
    """How often each robot is started again at most; None: as often as it fails."""

    def pause_s(self, exit_code: int, restarts: int, ran_s: float, last_s: float | None) -> float | None:
        """Return after how many seconds to start a robot again; None if it stays down.

        `restarts` is how often it has been, `ran_s` how long it ran, `last_s` the pause of last time.
        """
        if exit_code in (ExitCode.OK, ExitCode.INVALID):  # the same program would be refused again
            return None
        if self.times is not None and restarts >= self.times:
            return None
        if last_s is None or ran_s >= STEADY_S:
            return FIRST_PAUSE_S
        return min(2.0 * last_s, PAUSE_S_MAX)


def restart_policy(text: str) -> RestartPolicy | None:
    """Return the policy that ``no``, ``on-failure`` or ``on-failure:3`` names. Raises ValueError."""
    if text == "no":
        return None
    found = POLICY.fullmatch(text)
    if found is None:
        raise ValueError("should be no, on-failure, or on-failure:N with the number of restarts of each robot at most")
    return RestartPolicy(int(found[1]) if found[1] else None)
