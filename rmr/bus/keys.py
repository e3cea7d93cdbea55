"""The key space of one lab on the bus: one table, from which publishers, subscribers and docs derive.

    rmr/{lab}/radio/{cx}/{cy}     announcements of radio frames, by the cell of their sender on the floor
    rmr/{lab}/call/{id}           announcements of frames that this robot must acknowledge
    rmr/{lab}/body/{id}/sense     world -> robot: sensor samples
    rmr/{lab}/body/{id}/act       robot -> world: its wheel command
    rmr/{lab}/clock               world: answers requests for lab time; publishes its start, stop and jumps
    rmr/{lab}/map/{id}            world: answers a new robot with the map and admits it
    rmr/{lab}/disturbances        world: publishes changed disturbances of the radio; takes operators' requests
    rmr/{lab}/silence             request to the world: a robot hears no beacon for a while
    rmr/{lab}/truth               world: ground truth of all poses, for operators
    rmr/{lab}/ops/{who}/status    status of a robot or the world
    rmr/{lab}/ops/{who}/stop      request to a robot or the world to stop in order
    rmr/{lab}/hosts/{host}        launchers among each other: how the robots of a host are, and what runs there
    rmr/{lab}/hosts/{host}/order  launcher of a host: carries out what a person asks of its robots, or of the lab
    rmr/{lab}/hosts/{host}/look   launcher of a host: answers how its processes are, and with their logs
    rmr/{lab}/load/{id}           operator -> robot: a new program, in fragments
    rmr/{lab}/load/operator/{id}  robot -> operator: the answers
    rmr/{lab}/alive/{role}/{id}   liveliness tokens: ``robot/4``, ``world/0``
    rmr/{lab}/echo/{role}/{id}/{token}   of a process to itself: does its router carry what its role may say?

`who` is a robot's id or ``world``. On a bus with certificates the first two have the id of who speaks behind them,
which the rules of the routers bind to its certificate; without these nothing would, and a wild card for it costs 3 us
a message.
"""

import re
from dataclasses import dataclass
from typing import Final

from rmr.base.values import ROBOT_ID_MAX

WORLD: Final = "world"
"""The name of the world, in place of a robot's id."""

OPERATOR = "operator"
"""The name of whoever steers the lab, in place of a robot's id."""

ROBOT_ROLE = "robot"
WORLD_ROLE = "world"
"""Roles of liveliness tokens."""

LAB_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
"""A lab's name is one chunk of a key, so it holds none of zenoh's separators and wild cards (``/ * $ # ? @``)."""

ID = re.compile("0|[1-9][0-9]{0,4}", re.ASCII)
"""A robot's id as keys spell it."""

ANY_LAB = "*"
"""Wildcard in place of a lab's name."""


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one lab. Raises ValueError when `lab` cannot be part of a key."""

    lab: str

    def __post_init__(self) -> None:
        if self.lab != ANY_LAB and not LAB_NAME.fullmatch(self.lab):
            raise ValueError(f"'{self.lab}' cannot name a lab: letters, digits, '-', '_' and '.', 64 at most")

    def radio(self, cell_x: int, cell_y: int, speaker: str = "") -> str:
        """Return the key of a cell of the floor (`rmr.radio.cells`), with the id of a `speaker` (``*``: any) if any."""
        return f"rmr/{self.lab}/radio/{cell_x}/{cell_y}{speaker and f'/{speaker}'}"

    def call(self, robot: int, speaker: str = "") -> str:
        """Return the key of announcements that a robot must acknowledge at once, `speaker` as above."""
        return f"rmr/{self.lab}/call/{robot}{speaker and f'/{speaker}'}"

    def sense(self, robot: int) -> str:
        """Return the key of a robot's sensor samples."""
        return f"rmr/{self.lab}/body/{robot}/sense"

    def act(self, robot: int) -> str:
        """Return the key of a robot's wheel commands."""
        return f"rmr/{self.lab}/body/{robot}/act"

    @property
    def acts(self) -> str:
        """Key of all wheel commands (wild card)."""
        return f"rmr/{self.lab}/body/*/act"

    @property
    def clock(self) -> str:
        """Key of lab time."""
        return f"rmr/{self.lab}/clock"

    def map(self, robot: int | str) -> str:
        """Return the key on which a robot (``*``: any) asks for the map: all that it must know of its lab."""
        return f"rmr/{self.lab}/map/{robot}"

    @property
    def disturbances(self) -> str:
        """Key of the disturbances of the radio."""
        return f"rmr/{self.lab}/disturbances"

    @property
    def silence(self) -> str:
        """Key of requests for an outage of the localisation service."""
        return f"rmr/{self.lab}/silence"

    @property
    def truth(self) -> str:
        """Key of the ground truth."""
        return f"rmr/{self.lab}/truth"

    def status(self, who: int | str) -> str:
        """Return the key of the state of a robot or of the world."""
        return f"rmr/{self.lab}/ops/{who}/status"

    @property
    def statuses(self) -> str:
        """Key of all states (wild card)."""
        return f"rmr/{self.lab}/ops/*/status"

    def stop(self, who: int | str) -> str:
        """Return the key of requests to a robot or the world to stop."""
        return f"rmr/{self.lab}/ops/{who}/stop"

    def host(self, host: str) -> str:
        """Return the key of what the launcher of a host (``*``: any) tells the others."""
        return f"rmr/{self.lab}/hosts/{host}"

    def order(self, host: str) -> str:
        """Return the key of orders to the launcher of a host."""
        return f"{self.host(host)}/order"

    def look(self, host: str) -> str:
        """Return the key of questions to the launcher of a host (``*``: any)."""
        return f"{self.host(host)}/look"

    def load(self, robot: int) -> str:
        """Return the key of what a robot is told about new programs."""
        return f"rmr/{self.lab}/load/{robot}"

    def answers(self, robot: int | str) -> str:
        """Return the key of what a robot (``*``: any) answers to that."""
        return f"rmr/{self.lab}/load/{OPERATOR}/{robot}"

    def echo(self, role: str, ident: int | str, token: str) -> str:
        """Return the key of what a process with keys says to itself; `ident` is 0 but for robots."""
        return f"rmr/{self.lab}/echo/{role}/{ident}/{token}"

    @property
    def world_alive(self) -> str:
        """Key of the world's liveliness token."""
        return self.alive(WORLD_ROLE, 0)

    def alive(self, role: str, ident: int | str) -> str:
        """Return the key of a liveliness token; ``*`` for any."""
        return f"rmr/{self.lab}/alive/{role}/{ident}"


def sender_place(key: str) -> int:
    """Return where the keys of a topic name who alone speaks on them, as a place from the end; 0: nowhere."""
    chunks = key.split("/")
    if chunks[-1] in {"act", "status"}:
        return -2
    last = (len(chunks), *chunks[2:3]) in {(4, "map"), (5, "call"), (6, "radio")} or chunks[2:4] == ["load", OPERATOR]
    return -1 if last else 0


def last_id(key: str) -> int | None:
    """Return the robot's id at the end of an `alive` key, or None when there is none."""
    text = key.rsplit("/", 1)[-1]
    if ID.fullmatch(text) is None:
        return None
    return int(text) if int(text) <= ROBOT_ID_MAX else None
