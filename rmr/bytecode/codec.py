"""The codec: programs to octets and back (paper IV.A).

`encode` and `decode` are inverse to each other except for the debug table. Every program that a robot runs has passed
`decode`. Every defect of the octets (no byte-code, another version, truncated, damaged, malformed, or well-formed but
unsound) is a `BytecodeError` with the reason, never another exception and never a program. The newest programs are
cached by the hash of their octets.
"""

import hashlib

from rmr.base.identity import REMEMBERED_MAX
from rmr.bytecode.decoder import decode_tables
from rmr.bytecode.encoder import encode_tables
from rmr.bytecode.layout import (
    DEBUG,
    FLAG_DEADLINE,
    FLAG_DEBUG,
    FLAG_ENSEMBLE,
    FLAG_TEXTUAL,
    VERSION,
    assemble,
    read_layout,
    split,
)
from rmr.bytecode.octets import BytecodeError
from rmr.bytecode.program import Program, Strategy
from rmr.bytecode.verify import verify

__all__ = ["VERSION", "BytecodeError", "decode", "digest", "encode"]

_passed: dict[bytes, Program] = {}
"""Cache of the newest verified programs, by the SHA-256 hash of their octets."""


STRATEGY_FLAGS = {Strategy.RANDOM: 0, Strategy.TEXTUAL: FLAG_TEXTUAL, Strategy.DEADLINE: FLAG_DEADLINE}
"""The bit of the header's flags for each strategy."""


def encode(program: Program, *, debug: bool) -> bytes:
    """Return `program` as byte-code; with `debug` including the places in the source, if the program has them.

    Raises:
        BytecodeError: the program does not verify (the compiler's bug).
    """
    reasons = verify(program)
    if reasons:
        raise BytecodeError("the program does not verify: " + "; ".join(reasons))
    flags = STRATEGY_FLAGS[program.strategy]
    if debug and program.debug is not None:
        flags |= FLAG_DEBUG
    if program.ensemble:
        flags |= FLAG_ENSEMBLE
    return assemble(flags, encode_tables(program, debug))


def decode(data: bytes) -> Program:
    """Return the verified program in `data`; equal octets give the same object while it is cached.

    Raises:
        BytecodeError: the octets are no sound program.
    """
    # A cryptographic hash: a forged file must not pass for one that has been verified.
    key = hashlib.sha256(data).digest()
    program = _passed.get(key)
    if program is None:
        program = _verified(data)
        if len(_passed) >= REMEMBERED_MAX:
            del _passed[next(iter(_passed))]
        _passed[key] = program
    return program


def _verified(data: bytes) -> Program:
    data = split(data).program
    program = decode_tables(data, read_layout(data))
    reasons = verify(program)
    if reasons:
        raise BytecodeError("the byte-code does not verify: " + "; ".join(reasons[:3]))
    return program


def digest(data: bytes) -> int:
    """Return the 32-bit fingerprint by which robots compare their programs.

    It is the BLAKE2b hash of the byte-code without the debug table and signature, which a run does not read.

    Raises:
        BytecodeError: `data` is no intact byte-code.
    """
    data = split(data).program
    layout = read_layout(data)
    tables = {name: (table.entries, data[table.start : table.end]) for name, table in layout.tables.items()}
    plain = assemble(layout.flags & ~FLAG_DEBUG, {**tables, DEBUG: (0, b"")})
    return int.from_bytes(hashlib.blake2b(plain, digest_size=4).digest(), "big")
