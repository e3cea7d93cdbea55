"""A robot's change to another program, in the same life: what of its parts is kept, and what ends.

A node is made of parts that know its program's numbers. For a change all of them are made anew, and take over from
their predecessors what means the same under both programs (`rmr.bytecode.program_pair`):

    kept       where the robot is, its place, the positions of the others, facts from its senses, the report's counters
    carried    facts, goals, jobs and watches, actions under way with their chains, deliveries under way and held back
    ended      what of those the new program has not, and what belongs to a schedule: groups, slots, crossings
    settled    offers of ensemble rules, by the rules of the old program (`rmr.node.logic.earlier_program`)
    forgotten  deadlines inherited from deliveries that have arrived, candidate matches, waits of coordination

docs/load.md has the whole list. An action that is carried begins again: its handler is broken off and called anew.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from rmr.base.streams import Choices
from rmr.base.time import Instant
from rmr.bytecode.program_pair import ProgramPair
from rmr.node import payloads
from rmr.node.actions.action_log import ActionEnded
from rmr.node.actions.dispatcher import NEW_PROGRAM, Dispatcher
from rmr.node.crossing.crossings import Crossings
from rmr.node.executive import Executive
from rmr.node.logic.deliveries import ABOUT_JOBS, Deliveries
from rmr.node.logic.earlier_program import EarlierProgram, settled_predicates
from rmr.node.logic.machine_runner import MachineRunner
from rmr.node.logic.symbol_numbers import symbols_of
from rmr.node.messenger import Messenger, Transmitter
from rmr.node.payloads import Delivery, DeliveryRole, WireError
from rmr.node.robot_state import RobotState
from rmr.node.services import RobotServices
from rmr.vm.carrying import Carried, carry_over


@dataclass(frozen=True, slots=True)
class ProgramChanged:
    """A robot has changed its program; an event for checkers."""

    digest: int
    """Of the new program, 32 bits."""
    carried: Carried
    deliveries_ended: list[str] = field(default_factory=list)
    in_doubt: list[str] = field(default_factory=list)
    """Facts that are set aside for an offer, until it is settled by the rules of the old program."""

    def ended(self) -> list[str]:
        """Return what has ended, in words."""
        return [*self.carried.ended(), *(f"delivery {text}" for text in self.deliveries_ended)]


@dataclass(frozen=True, slots=True)
class NodeParts:
    """The parts of a node that know its program."""

    state: RobotState
    radio: Transmitter
    services: RobotServices
    crossings: Crossings
    actions: Dispatcher
    messenger: Messenger
    runner: MachineRunner
    executive: Executive

    def settle(self, now: Instant) -> None:
        """Let happen what has been reported, and break off the actions."""
        self.state.now = now
        self.runner.settle(now)
        self.messenger.flush(now)
        self.runner.settle(now)
        for running in self.actions.break_off():
            self.state.tell(ActionEnded(running.serial, running.text(self.state.robot), NEW_PROGRAM))


def take_over(now: Instant, old: NodeParts, new: NodeParts, digest: int) -> ProgramChanged:
    """Let the parts `new`, which have not been started, go on with what those of another program have left."""
    pair = ProgramPair(old.state.program, new.state.program)
    earlier = old.messenger.earlier
    settled = settled_predicates(old.state.program)
    if settled:
        state = old.state
        choices = Choices(f"{state.config.seed}/robot{state.robot}/vm")
        earlier[state.digest] = EarlierProgram(now, state.machine, state.digest, choices)
        earlier[state.digest].machine.count += old.messenger.offers_held
    new.state.now = now
    new.radio.follow(old.radio)
    new.executive.follow(old.executive)
    new.services.take_over(old.services)
    new.runner.follow(old.runner)
    new.messenger.malformed = old.messenger.malformed
    new.messenger.shared.follow(old.messenger.shared)
    deliveries = new.messenger.deliveries
    ended = change_deliveries(now, old.messenger.deliveries, deliveries, pair, digest, settled)
    new.messenger.exchange = deliveries.exchange
    deliveries.exchange.tell = new.state.tell
    carried = carry_over(now, old.state.machine, new.state.machine, pair)
    again = earlier.pop(new.state.digest, None)
    if again is not None and again.program.predicates == new.state.program.predicates:  # not by chance 16 bits alone
        again.machine.hand_over(now, new.state.machine)
    new.messenger.earlier = earlier
    # By the newest sixteen of those without an offer in doubt the robot still answers others that have not switched.
    for idle in [each.digest for each in earlier.values() if not each.open][:-16]:
        del earlier[idle], new.messenger.exchange.earlier[idle]
    for each in earlier.values():
        each.machine.serve(new.state.machine, each.program)
        each.run(now, new.messenger.exchange)
    new.state.senses.take_over(now, old.state.senses)
    for job in carried.jobs:
        new.crossings.started(now, job)
    in_doubt = [text for each in earlier.values() for text in each.machine.set_aside()]
    changed = ProgramChanged(digest, carried, ended, in_doubt)
    new.state.trace(now, "program", digest=f"{digest:08x}", facts=carried.facts, ended=changed.ended())
    new.state.tell(changed)
    new.runner.settle(now)
    new.messenger.flush(now)
    new.state.mark_dirty()
    return changed


# ---- a change of programs for the deliveries of a robot: what is under way, waits or is held back
#
# Numbers of predicates, time assertions and symbols belong to one program. A delivery whose predicate or assertion
# both programs have is encoded anew under the same sequence number, so that it arrives exactly once whether or not
# a copy has arrived before the change. Any other ends. Acknowledgements name no program and hold across the change.


def renewal(
    pair: ProgramPair, ended: Callable[[Delivery], None]
) -> Callable[[Delivery], tuple[Delivery, bytes] | None]:
    """Return what gives a delivery and its body in terms of the new program, or tells `ended` and gives None."""
    numbers = symbols_of(pair.new).numbers

    def renewed(delivery: Delivery) -> tuple[Delivery, bytes] | None:
        kept = pair.assertions if delivery.role in ABOUT_JOBS else pair.predicates
        index = kept[delivery.index] if delivery.index < len(kept) else None
        if index is not None:
            again = replace(delivery, index=index)
            try:
                return again, payloads.encode_delivery(again, numbers)
            except WireError:  # too long without the numbers of the old program's symbols
                pass
        ended(delivery)
        return None

    return renewed


def change_deliveries(
    now: int, old: Deliveries, new: Deliveries, pair: ProgramPair, digest: int, settled: frozenset[int]
) -> list[str]:
    """Let `new` go on with the exchange of `old`; return the deliveries that ended, in program syntax.

    The facts of the predicates `settled` stay deliveries of the old program.
    """
    ended: list[str] = []
    names = symbols_of(pair.old).names
    hidden = frozenset([each.predicate for each in pair.old.ensemble])

    def end(delivery: Delivery) -> None:
        if delivery.role is not DeliveryRole.FACT or delivery.index not in hidden:  # what was told is told anew
            ended.append(old.text(delivery))

    under_way = renewal(pair, end)
    held = renewal(pair, end)

    def body_of(body: bytes) -> bytes:
        try:
            found = held(payloads.decode_delivery(body, names))
        except WireError:
            return body  # it says nothing to either program: it is counted when it takes effect
        return b"" if found is None else found[1]

    new.take_over(old)
    new.exchange.change_program(now, digest, under_way, body_of, settled)
    return ended
