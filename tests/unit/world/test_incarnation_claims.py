"""One process is a robot at a time; each life is told when the one before had certainly ended."""

from rmr.base.time import seconds
from rmr_world.incarnation_claims import CLAIM_S, CLOCKS_APART, IncarnationClaims

ROBOT, FIRST, SECOND = 3, 111, 222


def test_a_second_process_is_refused_while_the_first_lives_or_has_just_asked():
    claims = IncarnationClaims()
    assert claims.claim(ROBOT, FIRST, 0.0, alive=False)
    assert not claims.claim(ROBOT, SECOND, CLAIM_S / 2, alive=False)
    assert not claims.claim(ROBOT, SECOND, 9.0, alive=True)
    assert claims.claim(ROBOT, FIRST, 9.0, alive=True)
    claims.release(ROBOT)
    assert claims.claim(ROBOT, SECOND, 9.1, alive=False)
    assert claims.life(ROBOT, SECOND)[0] == 1


def test_a_new_life_is_told_when_the_one_before_had_vanished_and_is_told_the_same_again():
    claims = IncarnationClaims()
    claims.claim(ROBOT, FIRST, 0.0, alive=False)
    assert claims.life(ROBOT, FIRST) == (0, None)
    claims.vanished(ROBOT, seconds(4))
    claims.release(ROBOT)
    claims.claim(ROBOT, SECOND, 9.0, alive=False)
    claims.vanished(ROBOT, seconds(20))  # its own connection was interrupted
    claims.claim(ROBOT, SECOND, 21.0, alive=False)
    assert claims.life(ROBOT, SECOND) == (1, seconds(4) + CLOCKS_APART)


def test_a_life_before_which_none_was_seen_on_the_bus_is_told_nothing():
    claims = IncarnationClaims()
    claims.claim(ROBOT, FIRST, 0.0, alive=False)
    claims.claim(ROBOT, SECOND, CLAIM_S + 0.1, alive=False)
    assert claims.life(ROBOT, SECOND) == (1, None)
