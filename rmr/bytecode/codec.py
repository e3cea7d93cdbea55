"""Programs to octets and back (paper IV.A).

`encode` and `decode` are inverse to each other but for what makes no difference to a run (the debug table).
`decode` is the gate through which everything passes that a robot will run: whatever is wrong with the octets
(no byte-code, another version, truncated, damaged, malformed, or well-formed but unsound) ends in a
`BytecodeError` with the reason, never in another exception and never in a program. Octets that have passed are
known by their hash for a while: they are the same program again.
"""

import hashlib

from rmr.base.identity import REMEMBERED_MAX
from rmr.bytecode.decoder import decode_tables
from rmr.bytecode.encoder import encode_tables
from rmr.bytecode.layout import DEBUG, FLAG_DEBUG, FLAG_TEXTUAL, VERSION, assemble, read_layout
from rmr.bytecode.octets import BytecodeError
from rmr.bytecode.program import Program, Strategy
from rmr.bytecode.verify import verify

__all__ = ["VERSION", "BytecodeError", "decode", "digest", "encode"]

_passed: dict[bytes, Program] = {}
"""The newest programs that have passed, by the SHA-256 hash of their octets."""


def encode(program: Program, *, debug: bool) -> bytes:
    """Return `program` as byte-code; with `debug` the places in the source go along if the program has them.

    Raises:
        BytecodeError: the program does not verify (the compiler's bug).
    """
    reasons = verify(program)
    if reasons:
        raise BytecodeError("the program does not verify: " + "; ".join(reasons))
    flags = FLAG_TEXTUAL if program.strategy is Strategy.TEXTUAL else 0
    if debug and program.debug is not None:
        flags |= FLAG_DEBUG
    return assemble(flags, encode_tables(program, debug))


def decode(data: bytes) -> Program:
    """Return the verified program in `data`, the same object for the same octets as long as they are remembered.

    Raises:
        BytecodeError: with the reason.
    """
    key = hashlib.sha256(data).digest()
    program = _passed.get(key)
    if program is None:
        program = _verified(data)
        if len(_passed) >= REMEMBERED_MAX:
            del _passed[next(iter(_passed))]
        _passed[key] = program
    return program


def _verified(data: bytes) -> Program:
    program = decode_tables(data, read_layout(data))
    reasons = verify(program)
    if reasons:
        raise BytecodeError("the byte-code does not verify: " + "; ".join(reasons[:3]))
    return program


def digest(data: bytes) -> int:
    """Return a 32-bit number by which robots tell whether they run the same program.

    It is the BLAKE2b hash of the byte-code as it is without a debug table: what makes no difference to a run
    makes no other program.

    Raises:
        BytecodeError: `data` is no intact byte-code.
    """
    layout = read_layout(data)
    tables = {name: (table.entries, data[table.start : table.end]) for name, table in layout.tables.items()}
    plain = assemble(layout.flags & ~FLAG_DEBUG, {**tables, DEBUG: (0, b"")})
    return int.from_bytes(hashlib.blake2b(plain, digest_size=4).digest(), "big")
