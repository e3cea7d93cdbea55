"""The verbs that steer a lab that runs, as subcommands of `rmr`.

The table stands alone, so that `rmr ps` becomes `rmr-fleet ps` without loading the parser of command lines twice.
"""

FLEET: dict[str, str] = {
    "ls": "List the labs that run on this machine.",
    "ps": "List the processes of a lab that runs, and how its robots are.",
    "logs": "Show the logs of a run as one, by lab time; also after its end.",
    "events": "Show what befell the processes of a run.",
    "stats": "Show processor time and memory of the processes, each second.",
    "top": "The same as stats.",
    "facts": "Show the facts that robots hold; also after the run.",
    "config": "Show the lab of a run, or a lab file, with all defaults.",
    "kill": "Kill robots, or send them another signal.",
    "stop": "Stop robots in order; the run goes on without them.",
    "start": "Start robots again that have ended.",
    "restart": "Start robots again, with --force also those that run.",
    "pause": "Hold robots' processes until they are unpaused.",
    "unpause": "Let paused robots go on.",
    "attach": "Show table and report of a lab that was started by hand.",
    "wait": "Wait until a run is over; the exit code is that of rmr up.",
    "down": "End a run in order, and wait until nothing of it is left.",
}
"""The subcommands of the program `rmr-fleet`, and their summaries."""
