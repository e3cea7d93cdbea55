"""A change of programs for the deliveries of a robot: what is under way, waits or is held back.

Numbers of predicates, time assertions and symbols belong to one program. A delivery whose predicate or assertion both
programs have is encoded anew under the same sequence number, so that it arrives exactly once whether or not a copy has
arrived before the change. Any other ends. Acknowledgements name no program and hold across the change.
"""

from collections.abc import Callable
from dataclasses import replace

from rmr.bytecode.program_pair import ProgramPair
from rmr.node import payloads
from rmr.node.logic.deliveries import ABOUT_JOBS, Deliveries
from rmr.node.logic.symbol_numbers import symbols_of
from rmr.node.payloads import Delivery, WireError


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


def change_deliveries(now: int, old: Deliveries, new: Deliveries, pair: ProgramPair, digest: int) -> list[str]:
    """Let `new` go on with the exchange of `old`; return the deliveries that ended, in program syntax."""
    ended: list[str] = []
    names = symbols_of(pair.old).names
    under_way = renewal(pair, lambda delivery: ended.append(old.text(delivery)))
    held = renewal(pair, lambda delivery: ended.append(old.text(delivery)))

    def body_of(body: bytes) -> bytes:
        try:
            found = held(payloads.decode_delivery(body, names))
        except WireError:
            return body  # it says nothing to either program: it is counted when it takes effect
        return b"" if found is None else found[1]

    new.take_over(old)
    new.exchange.change_program(now, digest, under_way, body_of)
    return ended
