"""How long a robot that begins waits for the others."""

import pytest

from rmr.base.arena import Arena
from rmr.base.time import Duration
from rmr.node.config import LISTEN, LISTEN_FOR_ALL, NodeConfig


@pytest.mark.parametrize(("side_m", "epoch", "listens"), [(1.5, 0, LISTEN_FOR_ALL), (30, 0, 0), (30, 1, LISTEN)])
def test_who_begins_listens_for_all_where_all_are_within_the_radios_range(
    side_m: float, epoch: int, listens: Duration
) -> None:
    assert NodeConfig(1, (1, 2), Arena(side_m, side_m, 0.1), 0, epoch=epoch).listens == listens
