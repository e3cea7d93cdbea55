"""What is heard is as good as what is seen, and who is silent may be anywhere that it can have reached."""

import pytest
from bench import safe_speed

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.time import Instant, in_seconds, milliseconds, seconds
from rmr.node.motion.hearing import SILENT, SILENT_PARKED, Hearing, ReportedState
from rmr.node.motion.priority import order_key
from rmr.node.payloads import Hello
from rmr.node.peers.hello import STAYS
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


@pytest.mark.parametrize("parked", [False, True])
def test_a_peer_is_silent_for_a_while_and_then_dead_where_it_fell(parked: bool) -> None:
    peers = Peers()
    peers.heard(0, 2, -50.0)
    peers.hello(0, 2, Hello(0.8, 0.5, 0.0, 0.0, parked, 0, None))
    assert [one.silent for one in peers.heard_of(seconds(1), HERE, 0.07)] == [False]
    assert [one.silent for one in peers.heard_of(seconds(3), HERE, 0.07)] == [True]
    assert peers.heard_of(seconds(16), HERE, 0.07) == []
    assert peers.parked(seconds(16)) == (Point(0.8, 0.5),)


def test_who_said_that_it_stays_is_silent_only_so_much_later():
    silent_s, stays_s = in_seconds(SILENT_PARKED), in_seconds(STAYS)
    for stays, late_s in ((False, silent_s), (True, silent_s + stays_s)):
        peers = Peers()
        peers.heard(0, 2, -50.0)
        peers.hello(0, 2, Hello(0.8, 0.5, 0.0, 0.0, True, 0, None, stays=stays))
        for now, silent in ((late_s - 0.1, False), (late_s + 0.1, True)):
            assert [one.silent for one in peers.heard_of(seconds(now), HERE, 0.07)] == [silent]
        near = hearing(*peers.heard_of(STAYS, HERE, 0.07))
        assert (near.forbids(STAYS, HERE, []) == 0) is stays


def test_a_promise_to_stay_counts_from_when_it_was_said_however_late_it_was_read():
    peers, read = Peers(), seconds(2)
    peers.heard(read, 2, -50.0)
    peers.hello(read, 2, Hello(0.8, 0.5, 0.0, 0.0, True, 0, None, stays=True), said=0)
    late_s = in_seconds(STAYS + SILENT_PARKED)
    assert [one.silent for one in peers.heard_of(seconds(late_s - 0.1), HERE, 0.07)] == [False]
    assert [one.silent for one in peers.heard_of(seconds(late_s + 0.1), HERE, 0.07)] == [True]


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
        (said,) = peers.heard_of(seconds(told), HERE, 0.07)
        assert (said.vx > 0.0) is moves
    peers.hello(seconds(4), 2, Hello(0.64, 0.7, 0.0, 0.0, False, 0, None))
    peers.hello(seconds(5), 2, Hello(0.64, 0.7, 0.0, 0.2, False, 0, None))
    assert peers.heard_of(seconds(5), HERE, 0.07)[0].vx > 0.0, "there is room enough"
