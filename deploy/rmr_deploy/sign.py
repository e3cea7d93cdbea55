"""`rmr sign`: signs a program with an operator's keys, for robots that run signed programs alone (`rmr.bus.signing`).

Importing this module loads next to nothing (see `rmr.entry`), and its help no cryptography.
"""
# ruff: noqa: PLC0415

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rmr.entry import ExitCode, run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

ABOUT = """\
Sign a program with an operator's keys.

Robots that have keys, or were started with --trust, run programs alone that an operator of their CA has signed. The
signature stands behind the byte-code in the same file, which all other robots run as before.
"""


def _declare(parser: "Parser") -> None:
    parser.positional("program", "PROG.rbc", read=Path, help="Byte-code; a signature that it has is replaced.")
    parser.option("--keys", metavar="DIR", read=Path, help="The folder with an operator's keys (default: RMR_KEYS).")
    parser.option("-o", "--output", metavar="OUT.rbc", read=Path, help="Where to write it; default: in its place.")


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command(
        ABOUT, _declare, _sign, "rmr load and rmr up sign by themselves, where they have an operator's keys."
    )


def _sign(program: Path, keys: Path | None, output: Path | None) -> int:
    from rmr.base.file_errors import naming
    from rmr.bus.certificates import CertificateError, credentials_path, moment
    from rmr.bus.signing import signer_of
    from rmr.bytecode import codec
    from rmr.bytecode.layout import SIZE_MAX, split
    from rmr.entry.command_line import CommandLineError

    folder = credentials_path(None, keys)
    if folder is None:
        raise CommandLineError("name the folder with an operator's keys with --keys DIR, which rmr keys bundle writes")
    output = output or program
    try:
        with naming(program), program.open("rb") as file:
            octets = file.read(SIZE_MAX + 1)
        codec.decode(octets)
        result = signed(octets, folder, anew=True)
        beside = output.with_name(f".{output.name}.new")
        with naming(output):
            beside.write_bytes(result)
            beside.replace(output)
    except codec.BytecodeError as error:
        hint = "; compile it first: rmrc PROG.rmr" if program.suffix == ".rmr" else ""
        print(f"rmr sign: {program}: {error}{hint}", file=sys.stderr)
        return ExitCode.INVALID
    except CertificateError as error:
        print(f"rmr sign: {error}", file=sys.stderr)
        return ExitCode.INVALID
    except OSError as error:
        print(f"rmr sign: {error.filename}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    who, end = signer_of(split(result).certificate)
    print(f"{output}: program {codec.digest(result):08x}, signed by {who}; robots take it until {moment(end)}")
    return ExitCode.OK


def signed(octets: bytes, keys: Path | None, *, anew: bool = False) -> bytes:
    """Return the program in `octets`, signed with the operator's `keys`: those of a folder, as a secret signs nothing.

    `anew`: also one that is signed already. Raises CertificateError, also for a program that becomes too large.
    """
    from rmr.bus.certificates import CertificateError
    from rmr.bytecode.layout import Signed, split
    from rmr.bytecode.octets import BytecodeError

    program = split(octets)
    if keys is None or not keys.is_dir() or (program.signature and not anew):
        return octets
    from rmr.bus.signing import signed_by

    try:
        return Signed(program.program, *signed_by(keys, program.program)).joined()
    except BytecodeError as error:
        raise CertificateError(str(error)) from None


def main(words: Sequence[str] | None = None, name: str = "rmr sign") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


if __name__ == "__main__":
    sys.exit(main())
