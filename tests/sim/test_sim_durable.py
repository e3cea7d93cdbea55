"""Durable robots in the simulator: killed at drawn instants and restarted, they lose and double nothing."""

from random import Random

import pytest
from lab_maker import small_lab, traced

from rmr.base.time import NS_PER_MS, milliseconds, seconds
from rmr_sim.event import Event
from rmr_sim.run_setup import prepare, report_of
from rmr_world.lab_program import ProgramError

SEEDS = [
    *(pytest.param(seed, marks=pytest.mark.medium) for seed in range(1, 5)),
    *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(5, 41)),
]

RING = """
    type action wait(R: robot, T: float) -o rested(R).
    type token(robot, int).
    type holds(robot, int).
    type rested(robot).
    type !next(robot, robot).
    type passed(robot, int).
    !next(@1, @2). !next(@2, @3). !next(@3, @1).
    token(R, N) -o holds(R, N), wait(R, 0.1).
    rested(R), holds(R, N), !next(R, S), N < 30 -o token(S, N + 1), passed(R, N).
"""
"""Each token is held for a while and passed on, thirty times."""

COINS = """
    type coin(robot, int).
    type asks(robot, robot, int).
    type wants(robot, int).
    type has(robot, int).
    type !keeper(robot, robot).
    !keeper(@2, @1). !keeper(@3, @1).
    wants(R, N), !keeper(R, K) -o asks(K, R, N).
    asks(K, R, N), coin(K, C) -o has(R, C).
"""

BANK = """
    type account(robot, int).
    type pay(robot, robot, int).
    type paid(robot, int).
    pay(R, S, N), account(R, B), B >= N -o account(R, B - N), paid(S, N).
    paid(R, N), account(R, B) -o account(R, B + N).
"""


class KillEvent(Event):
    """Kills a robot, if it lives."""

    def __init__(self, at, robot):
        super().__init__(at)
        self.robot = robot

    def happen(self, simulation):
        if not simulation.is_dead(self.robot):
            simulation.kill(self.robot)


class RestartEvent(KillEvent):
    """Restarts a robot, if it is dead."""

    def happen(self, simulation):
        if simulation.is_dead(self.robot):
            simulation.restart(self.robot)


def with_kills(simulation, seed, robots, until_s, kills=6):
    """Kill and restart robots at instants drawn from `seed`; all live again at the end."""
    chance = Random(seed)
    for _ in range(kills):
        robot = chance.choice(robots)
        at = chance.randrange(seconds(until_s))
        simulation.schedule(KillEvent(at, robot))
        simulation.schedule(RestartEvent(at + chance.randrange(NS_PER_MS, seconds(1.5)), robot))
    for robot in robots:
        simulation.schedule(RestartEvent(seconds(until_s + 2), robot))
    return simulation


def facts(simulation, name):
    """Return the arguments of all facts of a predicate, without the owner, over all robots."""
    listed = [fact for part in simulation.robot_parts().values() for fact in part["facts"]]
    return [tuple(fact[len(name) + 1 : -1].split(", ")) for fact in listed if fact.startswith(f"{name}(")]


def run(tmp_path, program, given, seed, **options):
    simulation = small_lab(
        tmp_path, program, robots=3, facts=given, loss=0.2, seed=seed, duration="20s", durable=True, **options
    )
    with_kills(simulation, seed, [1, 2, 3], 8)
    simulation.run()
    assert simulation.violations == []
    assert sum(robot.restarts for robot in simulation.robots) > 0
    return simulation


@pytest.mark.parametrize("seed", SEEDS)
def test_tokens_of_a_ring_are_neither_lost_nor_doubled(tmp_path, seed):
    simulation = run(tmp_path, RING, '["token(@1, 0)"]', seed)
    passed = sorted(int(number) for _, number in facts(simulation, "passed"))
    held = [int(number) for _, number in facts(simulation, "holds")]
    assert passed == list(range(30))
    assert held == [30]
    assert facts(simulation, "token") == []


@pytest.mark.parametrize("seed", SEEDS)
def test_a_keeper_of_coins_hands_each_out_once(tmp_path, seed):
    coins = ", ".join(f'"coin(@1, {number})"' for number in range(20))
    simulation = small_lab(
        tmp_path, COINS, robots=3, facts=f"[{coins}]", loss=0.2, seed=seed, duration="20s", durable=True
    )
    with_kills(simulation, seed, [1, 2, 3], 8)
    chance = Random(-seed)
    for number in range(16):

        class Wants(Event):
            robot = chance.choice([2, 3])
            wanted = number

            def happen(self, simulation):
                simulation.insert(self.robot, "wants", self.wanted)
                inserted.append(not simulation.is_dead(self.robot))

        simulation.schedule(Wants(chance.randrange(seconds(8))))
    inserted = []
    simulation.run()
    assert simulation.violations == []
    given = [int(coin) for _, coin in facts(simulation, "has")]
    kept = [int(coin) for _, coin in facts(simulation, "coin")]
    assert sorted(given + kept) == list(range(20))
    assert len(given) == sum(inserted)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_sum_of_a_bank_of_facts_stays_what_it_was(tmp_path, seed):
    pays = ", ".join(f'"pay(@{1 + n % 3}, @{1 + (n + 1) % 3}, {1 + n})"' for n in range(12))
    accounts = '"account(@1, 100)", "account(@2, 100)", "account(@3, 100)"'
    simulation = run(tmp_path, BANK, f"[{accounts}, {pays}]", seed)
    assert facts(simulation, "pay") == []
    assert facts(simulation, "paid") == []
    balances = {robot: int(balance) for robot, balance in facts(simulation, "account")}
    assert sum(balances.values()) == 300
    assert len(balances) == 3


BEHIND_A_COUNT = """
    order textual.
    type log(robot, list int).
    log(R, []).
    count(@2, 20000).
    count(R, N), N > 0 -o count(R, N - 1).
    got(R, N), count(R, 0) -o done(R, N).
    done(R, N), log(R, L) -o log(R, L + [N]), count(R, 0).
    go(@1).
    go(R) -o got(@2, 1), got(@2, 2), got(@2, 3), got(@2, 4), got(@2, 5).
"""
"""Deliveries wait for two thirds of a second until the rules of robot 2 are quiet."""


@pytest.mark.parametrize("at_s", [0.1, 0.3, 0.5])
def test_deliveries_that_wait_for_the_rules_of_their_robot_are_not_lost_with_its_process(tmp_path, at_s):
    simulation = small_lab(tmp_path, BEHIND_A_COUNT, robots=2, duration="5s", durable=True)
    waiting = []

    class Look(KillEvent):
        def happen(self, simulation):
            waiting.append(len(simulation.robots[1].node.messenger.exchange.arrivals))
            super().happen(simulation)

    simulation.schedule(Look(seconds(at_s), 2))
    simulation.schedule(RestartEvent(seconds(at_s + 0.2), 2))
    simulation.run()
    assert waiting == [5]
    assert simulation.violations == []
    assert facts(simulation, "log") == [("@1", "[]"), ("@2", "[1", "2", "3", "4", "5]")]


@pytest.mark.medium
def test_without_state_a_killed_keeper_forgets(tmp_path):
    simulation = small_lab(tmp_path, RING, robots=3, facts='["token(@1, 0)"]', seed=1, duration="8s")
    simulation.schedule(KillEvent(seconds(1), 2))
    simulation.schedule(RestartEvent(seconds(1.2), 2))
    simulation.run()
    passed = [int(number) for _, number in facts(simulation, "passed")]
    assert sorted(passed) != list(range(30))


@pytest.mark.medium
def test_a_lab_of_driving_robots_goes_on_where_it_was(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action goto(robot, float, float).
        type action face(R: robot, D: float) -o turned(R).
        go(R).
        go(R) -o goto(R, 0.7, 1.0), face(R, 90).
        """,
        finish="turned(R)",
        durable=True,
    )
    simulation.schedule(KillEvent(seconds(2), 1))
    simulation.schedule(RestartEvent(seconds(2) + milliseconds(700), 1))
    assert simulation.run()
    [robot] = simulation.robot_parts().values()
    assert robot["restarts"] == 1
    assert [text for _, text in robot["actions"]] == ["goto(@1, 0.7, 1.0)", "face(@1, 90.0)"]
    assert report_of(simulation, True)["violations"] == []
    assert traced(simulation, "fault")


@pytest.mark.medium
def test_a_durable_robot_and_a_new_program_are_refused_together(tmp_path):
    (tmp_path / "other.rmr").write_text(RING)
    small_lab(tmp_path, RING)
    with (tmp_path / "lab.yaml").open("a") as lab:
        lab.write("loads: [{at: 1s, program: other.rmr}]\n")
    with pytest.raises(ProgramError, match="loads: the state of a durable robot belongs to its program"):
        prepare(tmp_path, durable=True)
