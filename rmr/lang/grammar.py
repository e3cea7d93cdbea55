"""The parser's tables, made from the grammar once per machine and kept in the user's cache.

Building them takes some 60 ms, loading them 10. What stands in the cache is found by a hash of the grammar, of lark's
version and of Python's, is written whole or not at all, and is made anew whenever it cannot be read; a machine
without a writable cache does without.
"""

import hashlib
import os
import sys
import tempfile
from functools import cache
from importlib.resources import files
from pathlib import Path

import lark
from lark import Lark


@cache
def grammar() -> Lark:
    """Return the parser, made or loaded once per process."""
    text = files("rmr.lang").joinpath("rmr.lark").read_text(encoding="utf-8")
    path = cache_path(text)
    try:
        with path.open("rb") as file:
            return Lark.load(file)
    except Exception:  # absent, or left by a broken disk: whatever it is, it is made anew
        parser = Lark(text, parser="lalr", lexer="contextual", start="item", propagate_positions=True)
        _keep(parser, path)
        return parser


def cache_path(text: str) -> Path:
    """Return where the tables of the grammar `text` are kept."""
    identity = hashlib.sha256(f"{lark.__version__}/{sys.version}/{text}".encode()).hexdigest()[:16]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return home / "rmr" / f"grammar-{identity}"


def _keep(parser: Lark, path: Path) -> None:
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            parser.save(file)
        Path(file.name).replace(path)
    except OSError:
        return
