"""Runs a command in this process, as the console scripts do, and keeps what it prints."""

import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from rmr.entry.command_line import Runnable


@dataclass(frozen=True)
class Result:
    """What a command did: its exit code, and what it printed."""

    exit_code: int
    stdout: str
    stderr: str
    output: str
    """Both as they came."""
    exception: BaseException | None


class _Tee(io.TextIOWrapper):
    """A text stream whose octets go into two buffers."""

    def __init__(self, own: io.BytesIO, both: io.BytesIO) -> None:
        super().__init__(_Both(own, both), encoding="utf-8", write_through=True)


class _Both(io.RawIOBase):
    def __init__(self, own: io.BytesIO, both: io.BytesIO) -> None:
        self._buffers = own, both

    def writable(self) -> bool:
        return True

    def write(self, octets) -> int:
        for buffer in self._buffers:
            buffer.write(octets)
        return len(octets)


def invoke(
    command: Runnable,
    words: Sequence[str] = (),
    *,
    name: str = "rmr",
    text: str | bytes | None = None,
    catch_exceptions: bool = True,
) -> Result:
    """Run `command` with `words` as the command `name`, and `text` on its standard input."""
    streams = sys.stdin, sys.stdout, sys.stderr
    out, err, both = io.BytesIO(), io.BytesIO(), io.BytesIO()
    given = text.encode() if isinstance(text, str) else text or b""
    code, exception = 0, None
    sys.stdin = io.TextIOWrapper(io.BytesIO(given), encoding="utf-8")
    sys.stdout, sys.stderr = _Tee(out, both), _Tee(err, both)
    try:
        code = int(command.main(list(map(str, words)), name))
    except SystemExit as ended:
        exception, code = ended, int(ended.code or 0)
    except Exception as error:
        if not catch_exceptions:
            raise
        exception, code = error, 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        sys.stdin, sys.stdout, sys.stderr = streams
    return Result(code, *(each.getvalue().decode(errors="replace") for each in (out, err, both)), exception)
