"""What checkers remember stays bounded, however long a lab runs and however many events it has."""

from lab_maker import small_lab

from rmr.base.time import seconds
from rmr.coord.events import Entered, LeadershipBegan, LeadershipEnded, SlotAssigned, SlotLost
from rmr_sim.checkers import run_view

KEPT = 20
EVENTS = 100


def kept(simulation):
    """Return how much each table of each checker holds, by the checker's and the table's name."""
    return {
        (type(checker).__name__, name): len(table)
        for checker in simulation.checkers
        for name, table in vars(checker).items()
        if isinstance(table, dict | set)
    }


def test_tables_of_events_that_are_over_stay_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(run_view, "KEPT_MAX", KEPT)
    simulation = small_lab(tmp_path, "idle(R).\nidle(R), never(R) -o done(R).\n", robots=2)
    before = kept(simulation)
    for number in range(EVENTS):
        event, now = number.to_bytes(6, "big"), seconds(number)
        slot = SlotAssigned(
            group_id=event, trigger=now, rank=1, place=1, start=now, end=now + seconds(3), leader=1, term=number
        )
        simulation.tell(1, now, LeadershipBegan(event, number))
        simulation.tell(1, now, slot)
        simulation.tell(2, now, slot)
        simulation.tell(2, now, Entered(event, now, now + seconds(3), False))
        simulation.tell(1, now, SlotLost(event))
        simulation.tell(1, now, slot)
        simulation.tell(1, now, LeadershipEnded(event))
        for check in simulation.checkers:
            check(now)
    assert {name: count for name, count in kept(simulation).items() if count > max(KEPT, before[name])} == {}


def test_the_entries_set_last_are_kept(monkeypatch):
    monkeypatch.setattr(run_view, "KEPT_MAX", 2)
    table = run_view.RecentTable()
    for key in "abac":
        table[key] = None
    assert list(table) == ["a", "c"]
