"""The options of `rmr up`, as its parts take them."""

from dataclasses import dataclass
from pathlib import Path

from rmr_deploy.restarts import RestartPolicy


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """The options of `rmr up`; None where the lab decides."""

    lab: Path
    """A lab file or its folder."""
    robots: int | None = None
    """How many of the lab's robots, from the first."""
    seed: int | None = None
    actions: Path | None = None
    """A file with the handlers of the program's own actions, instead of the lab's."""
    as_json: bool = False
    strict: bool = False
    folder: Path | None = None
    """The run folder."""
    timeout_s: float | None = None
    """Wall time of the run at most."""
    processes: int | None = None
    """Over how many processes the robots are spread, neighbours in the roster together; None: each has its own."""
    record: Path | None = None
    """The recording, in place of `run.mcap` in the run folder."""
    no_record: bool = False
    durable: bool = False
    """Whether robots keep their state over a restart."""
    keep_going: bool = False
    """Whether the others go on when a robot has died."""
    restart: RestartPolicy | None = None
    """When a robot that has failed is started again."""
    view: bool = False
    """Whether the run has a page, even where standard output is no terminal."""
    no_view: bool = False
    """Whether the run has no page."""
    port: int | None = None
    """The page's port; None: a free one."""
    control: bool = False
    """Whether the page may add faults."""
    ros2: bool = False
    """Whether the world shows its robots to ROS 2."""
    keys: Path | None = None
    """The folder of the CA that has issued the keys of the processes; None where they have a secret."""
    watch: bool = False
    """Whether the program is compiled and loaded when its source is saved."""
    hosts: Path | None = None
    """A file that says which host has what, in place of the lab's own `hosts`."""
    here: str | None = None
    """Which of the hosts this is; None: the whole lab runs on this machine."""
    secret: Path | None = None
    """The file with the secret that all hosts share."""
    opened: bool = False
    """Whether hosts go without a secret."""
    wait_s: float | None = None
    """How long hosts wait for each other; None: `host_share.WAIT_S`."""
