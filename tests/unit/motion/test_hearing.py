"""What is heard is as good as what is seen, and who is silent may be anywhere that it can have reached."""

from collections.abc import Sequence

import pytest
from bench import safe_speed

from rmr.base.arena import Arena, RobotShape
from rmr.base.geometry import STILL, Point, Pose, Twist
from rmr.base.time import Duration, Instant, in_seconds, milliseconds, seconds
from rmr.node.motion.hearing import CUT_OFF, DEAD, SILENT, SILENT_PARKED, Hearing, ReportedState
from rmr.node.motion.priority import order_key
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.speed_control import SpeedControl
from rmr.node.payloads import Hello
from rmr.node.peers.hello import STAYS
from rmr.node.peers.link_sensing import CUT_OFF_MAX, LISTED, LinkSensing
from rmr.node.peers.perception import Peers
from rmr.node.ports import SeenBody

SHAPE = RobotShape()
HERE = Pose(0.5, 0.5, 0.0)


def known(
    x: float,
    y: float,
    *,
    robot: int = 2,
    vy: float = 0.0,
    at: Instant = 0,
    parked: bool = False,
    silent: bool = False,
    rank: int = 0,
) -> ReportedState:
    return ReportedState(robot, x, y, 0.0, vy, at, parked, silent, rank)


def hearing(*others: ReportedState) -> Hearing:
    made = Hearing(SHAPE)
    made.update(HERE, others)
    return made


def test_a_robot_that_comes_from_the_side_unseen_is_stopped_for() -> None:
    around = hearing(known(0.58, 0.66, vy=-0.2)).around(0, HERE, ())
    assert safe_speed(0.2, around) < 0.15


def test_it_is_where_it_has_driven_since_it_was_heard() -> None:
    (body,) = hearing(known(0.6, 0.88, vy=-0.2)).around(seconds(1), HERE, ())
    assert (body.x, body.y) == pytest.approx((0.1, 0.18))


def test_behind_it_is_where_it_was_heard_if_it_has_driven_off_and_where_it_has_driven_if_it_comes() -> None:
    leaves, comes = (known(0.45, y, robot=2, vy=-0.08) for y in (0.34, 0.74))
    first, second = hearing(leaves, comes).around(seconds(1), HERE, ())
    assert (first.x, first.y) == pytest.approx((-0.05, -0.16))
    assert (second.x, second.y) == pytest.approx((-0.05, 0.16))


def test_a_robot_that_is_parked_beside_the_way_and_not_seen_is_not_driven_into() -> None:
    assert safe_speed(0.2, hearing(known(0.53, 0.637, parked=True)).around(0, HERE, ())) < 0.05
    assert safe_speed(0.2, hearing(known(0.53, 0.67, parked=True)).around(0, HERE, ())) == 0.2


@pytest.mark.parametrize(("gap_m", "shift_m"), [(0.0, 0.0), (0.005, 0.0), (0.025, 0.02), (0.1, 0.02)])
def test_spare_of_a_parked_robot_ends_where_the_hulls_come_close(gap_m: float, shift_m: float) -> None:
    away = 2.0 * SHAPE.radius + gap_m
    (body,) = hearing(known(0.5 + away, 0.5, parked=True)).around(0, Pose(0.5, 0.5, 0.0), ())
    assert body.x - away == pytest.approx(shift_m, abs=1e-9)


def test_who_is_seen_counts_once_and_who_is_far_away_not_at_all() -> None:
    others = known(0.7, 0.5), known(2.5, 0.5)
    assert hearing(*others).around(0, HERE, [SeenBody(0.21, 0.01, 0.0, 0.0)]) == []


def test_the_order_says_who_goes_before_those_that_are_seen_or_heard() -> None:
    made = hearing(*(known(0.7, y, robot=robot, rank=rank) for robot, y, rank in ((2, 0.3, 1), (3, 0.5, 4))))
    made.order = order_key(3, 1)
    earlier, later, unknown = SeenBody(0.21, -0.2, 0.0, 0.0), SeenBody(0.2, 0.0, 0.0, 0.0), SeenBody(0.2, 0.2, 0.0, 0.0)
    assert made.goes_before(0, HERE, [earlier, later, unknown]) == {earlier: False, later: True}


def test_a_parked_robot_and_one_without_a_rank_are_not_in_the_order() -> None:
    parked = known(0.7, 0.3, robot=2, parked=True, rank=1)
    made = hearing(parked, known(0.7, 0.5, robot=3))
    assert made.goes_before(0, HERE, made.around(0, HERE, ())) == {}


@pytest.mark.parametrize(("age_s", "stands"), [(1.3, False), (3.5, True)])
def test_a_silent_robot_keeps_another_standing_as_soon_as_it_may_have_come_near(age_s: float, stands: bool) -> None:
    assert hearing(known(1.3, 0.5, silent=True)).forbids(seconds(age_s), HERE, ()) == (SILENT if stands else 0)


def test_a_robot_that_has_not_heard_everybody_yet_stands() -> None:
    made = hearing()
    made.listens = True
    assert made.forbids(0, HERE, ())
    made.listens = False
    assert not made.forbids(0, HERE, ())


def test_a_robot_that_is_heard_keeps_nobody_standing() -> None:
    assert not hearing(known(0.8, 0.5)).forbids(seconds(0.5), HERE, ())


@pytest.mark.parametrize(("x", "y"), [(0.55, 0.7), (0.5, 0.3)])
def test_of_one_that_is_near_and_unseen_two_lost_hellos_are_a_silence(x: float, y: float) -> None:
    made = hearing(known(x, y))
    assert not made.forbids(milliseconds(450), HERE, ())
    assert made.forbids(milliseconds(600), HERE, ())


def test_unless_it_is_behind_or_cannot_have_come_near() -> None:
    for place in (known(0.28, 0.45), known(0.5, 0.95)):
        assert not hearing(place).forbids(milliseconds(600), HERE, ())


def test_who_sets_out_waits_for_one_overdue_hello_of_a_parked_robot_who_drives_for_two() -> None:
    made = hearing(known(0.5, 0.7, parked=True))
    assert not made.forbids(milliseconds(650), HERE, ())
    assert made.forbids(milliseconds(750), HERE, ())
    made.stands = False
    assert not made.forbids(milliseconds(1200), HERE, ())
    assert made.forbids(milliseconds(1300), HERE, ())


def test_a_body_is_not_taken_for_the_silent_robot_if_it_may_be_another_that_is_heard() -> None:
    overdue, heard, body = known(0.65, 0.7), known(0.7, 0.6, at=milliseconds(500)), SeenBody(0.2, 0.1, 0.0, 0.0)
    assert not hearing(overdue).forbids(milliseconds(600), HERE, [body])
    assert hearing(overdue, heard).forbids(milliseconds(600), HERE, [body])


def test_a_silent_robot_that_is_in_view_is_left_to_sight() -> None:
    made, seen = hearing(known(0.8, 0.5, silent=True)), SeenBody(0.25, 0.0, 0.0, 0.0)
    assert not made.forbids(seconds(2), HERE, [seen])


def test_one_body_in_view_is_not_two_silent_robots() -> None:
    made = hearing(known(0.8, 0.5, silent=True), known(0.8, 0.6, silent=True))
    assert made.forbids(seconds(2), HERE, [SeenBody(0.25, 0.0, 0.0, 0.0)])


def test_a_body_in_view_that_said_that_it_is_there_is_no_silent_one() -> None:
    made = hearing(known(0.8, 0.5, silent=True), known(0.75, 0.5, at=seconds(2)))
    assert made.forbids(seconds(2), HERE, [SeenBody(0.25, 0.0, 0.0, 0.0)])


def test_a_parked_robot_has_settled_when_it_has_been_heard_there_for_a_second() -> None:
    peers = Peers()

    def settled(now: float, x: float, *, parked: bool) -> list[bool]:
        peers.heard(seconds(now), 2, -50.0)
        peers.hello(seconds(now), 2, Hello(x, 0.5, 0.0, 0.0, parked, 0, None))
        return [one.settled for one in peers.heard_of(seconds(now), HERE, SHAPE)]

    assert settled(1.0, 0.8, parked=True) == [False]
    assert settled(1.5, 0.81, parked=True) == [False]
    assert settled(2.0, 0.8, parked=True) == [True]
    assert settled(2.2, 0.8, parked=False) == [False]
    assert settled(2.4, 0.8, parked=True) == [False]
    assert settled(3.4, 0.8, parked=True) == [True]
    assert settled(4.4, 0.83, parked=True) == [False], "it stands elsewhere"


@pytest.mark.parametrize("parked", [False, True])
def test_a_peer_is_silent_for_a_while_and_then_dead_where_it_fell(parked: bool) -> None:
    peers = Peers()
    peers.heard(0, 2, -50.0)
    peers.hello(0, 2, Hello(0.8, 0.5, 0.0, 0.0, parked, 0, None))
    assert [one.silent for one in peers.heard_of(seconds(1), HERE, SHAPE)] == [False]
    assert [one.silent for one in peers.heard_of(seconds(3), HERE, SHAPE)] == [True]
    assert peers.heard_of(seconds(16), HERE, SHAPE) == []
    assert peers.parked(seconds(16)) == (Point(0.8, 0.5),)


def test_who_said_that_it_stays_is_silent_only_so_much_later():
    silent_s, stays_s = in_seconds(SILENT_PARKED), in_seconds(STAYS)
    for stays, late_s in ((False, silent_s), (True, silent_s + stays_s)):
        peers = Peers()
        peers.heard(0, 2, -50.0)
        peers.hello(0, 2, Hello(0.8, 0.5, 0.0, 0.0, True, 0, None, stays=stays))
        for now, silent in ((late_s - 0.1, False), (late_s + 0.1, True)):
            assert [one.silent for one in peers.heard_of(seconds(now), HERE, SHAPE)] == [silent]
        near = hearing(*peers.heard_of(STAYS, HERE, SHAPE))
        assert (near.forbids(STAYS, HERE, []) == 0) is stays


def test_a_promise_to_stay_counts_from_when_it_was_said_however_late_it_was_read():
    peers, read = Peers(), seconds(2)
    peers.heard(read, 2, -50.0)
    peers.hello(read, 2, Hello(0.8, 0.5, 0.0, 0.0, True, 0, None, stays=True), said=0)
    late_s = in_seconds(STAYS + SILENT_PARKED)
    assert [one.silent for one in peers.heard_of(seconds(late_s - 0.1), HERE, SHAPE)] == [False]
    assert [one.silent for one in peers.heard_of(seconds(late_s + 0.1), HERE, SHAPE)] == [True]


def test_who_sets_out_from_right_beside_may_not_get_away_and_stands_until_it_says_that_it_is_elsewhere():
    peers = Peers()
    peers.heard(0, 2, -50.0)
    for told, (x, v), moves in (
        (0, (0.6, 0.0), False),
        (1, (0.61, 0.2), False),
        (2, (0.61, 0.2), False),
        (3, (0.64, 0.2), True),
    ):
        peers.hello(seconds(told), 2, Hello(x, 0.6, 0.0, v, False, 0, None))
        (said,) = peers.heard_of(seconds(told), HERE, SHAPE)
        assert (said.vx > 0.0) is moves
    peers.hello(seconds(4), 2, Hello(0.64, 0.7, 0.0, 0.0, False, 0, None))
    peers.hello(seconds(5), 2, Hello(0.64, 0.7, 0.0, 0.2, False, 0, None))
    assert peers.heard_of(seconds(5), HERE, SHAPE)[0].vx > 0.0, "there is room enough"


BEHIND = Pose(0.5, 0.5, 0.0)


def backs(age: float, away_m: float, *, vx: float = 0.0, parked: bool = False, within_m: float = 0.17) -> bool:
    """Return whether a robot heard `age` seconds ago, `away_m` behind, may have come near one that backs up by 3 cm."""
    other = ReportedState(2, 0.5 - away_m, 0.5, vx, 0.0, 0, parked, False)
    heard = Hearing(SHAPE)
    heard.update(BEHIND, [other])
    return heard.may_reach(seconds(1) * round(age * 100) // 100, BEHIND, 0.03, within_m)


def test_one_that_stood_behind_may_have_driven_up_since_it_was_heard() -> None:
    assert not backs(0.0, 0.225)
    assert not backs(0.2, 0.225)
    assert backs(0.47, 0.225)


def test_one_that_drove_behind_may_have_come_nearer_sooner() -> None:
    assert not backs(0.1, 0.225, vx=0.2)
    assert backs(0.15, 0.225, vx=0.2)


def test_a_parked_one_behind_and_one_ahead_do_not_forbid_to_back_up() -> None:
    assert not backs(2.0, 0.225, parked=True)
    assert not backs(2.0, -0.225)


def test_a_robot_that_others_presume_dead_stands() -> None:
    made = hearing()
    made.cut_off = True
    assert made.forbids(0, HERE, ()) == CUT_OFF
    made.heeds &= ~CUT_OFF
    assert made.forbids(0, HERE, ()) == 0


def listing(roster: Sequence[int], by: int, heard: Sequence[int], at: Instant) -> bytes:
    return LinkSensing(by, roster).list_of(dict.fromkeys(heard, at), at)


def presumed(listed_at: Instant | None) -> tuple[Peers, Instant]:
    """Return robot 1's peers, and when they count robot 2 as dead: heard at 0 s only, and listed up to `listed_at`."""
    roster = (1, 2, 3)
    peers = Peers(LinkSensing(1, roster))
    for robot in (2, 3):
        peers.heard(0, robot, -50.0)
        peers.hello(0, robot, Hello(0.5 + 0.1 * robot, 0.5, 0.0, 0.2, False, 0, None))
    for at in range(0, seconds(70), seconds(1)):
        heard = [1, 2] if listed_at is not None and at <= listed_at else [1]
        peers.heard(at, 3, -50.0)
        peers.hello(at, 3, Hello(0.8, 0.5, 0.0, 0.0, True, 0, None, listed=listing(roster, 3, heard, at)))
        if 2 in peers.lost(at):
            break
    return peers, at


@pytest.mark.parametrize(
    ("listed_at", "dead_after"),
    [(None, DEAD), (seconds(20), seconds(20) - LISTED + DEAD), (seconds(70), CUT_OFF_MAX)],
    ids=["heard by nobody", "listed by another robot for 20 s", "listed for ever, never heard"],
)
def test_a_robot_is_presumed_dead_15_s_after_anybody_has_surely_heard_it(
    listed_at: Instant | None, dead_after: Duration
) -> None:
    peers, last = presumed(listed_at)
    assert dead_after < last <= dead_after + seconds(1)
    assert peers.lost(last)[2].silent_since == 0


def test_near_a_dead_robot_that_may_have_driven_on_a_robot_drives_by_sight() -> None:
    peers, now = presumed(None)
    assert peers.hides(now, Pose(0.5, 0.5, 0.0), SHAPE, (1, 2, 3), 1)
    assert not peers.hides(now, Pose(5.0, 0.5, 0.0), SHAPE, (1, 2, 3), 1)
    assert peers.hides(now, Pose(5.0, 0.5, 0.0), SHAPE, (1, 2, 3, 4), 1), "robot 4 may be anywhere"


def by_sight(*, sees_all: bool) -> SpeedControl:
    control = SpeedControl(Arena(2.0, 2.0, 0.05), 3, RuleSwitches())
    control.hearing.by_sight = not sees_all
    control.perceive(0, Pose(1.0, 1.0, 0.0), ())
    return control


def test_by_sight_a_robot_turns_on_the_spot_and_drives_straight_on() -> None:
    arc = Twist(0.2, 1.0)
    assert by_sight(sees_all=True).slowed(arc) == arc
    assert by_sight(sees_all=False).slowed(arc) == Twist(0.0, 1.0)
    assert by_sight(sees_all=False).slowed(Twist(0.2, 0.3)) == Twist(0.2, 0.3)


def test_by_sight_a_robot_does_not_back_up() -> None:
    assert by_sight(sees_all=True).reverse().v < 0.0
    assert by_sight(sees_all=False).reverse() == STILL
