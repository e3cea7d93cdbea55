"""The parser's LALR(1) tables, loaded from the package.

lark reads the grammar (`rmr.lark`) and works out the automaton; `rmr.lang.read.table_maker` turns what it finds into
`tables.json`, which is part of the package. So a start needs neither lark nor any file outside the package: loading the
tables takes 0.7 ms, importing lark 22 ms and loading a parser that `Lark.save` wrote another 4 ms, in a command that
takes 130 ms for a small program. A grammar that has been edited since the tables were made is noticed by its checksum,
and its tables are made in memory, by lark, until `python -m rmr.lang.read.table_maker` is run.
"""

import json
from functools import cache

from rmr.lang.read.grammar import TABLES_FILE, GrammarRule, Tables, Terminal, checksum, grammar_text


@cache
def tables() -> Tables:
    """Return the tables, loaded or made once per process."""
    text = grammar_text()
    kept = json.loads(TABLES_FILE.read_text(encoding="utf-8"))
    if kept["grammar"] != checksum(text):
        from rmr.lang.read.table_maker import made  # noqa: PLC0415 - lark is loaded where the grammar was edited

        return made(text)
    rules = [GrammarRule(*rule) for rule in kept["rules"]]
    terminals = [Terminal(*terminal) for terminal in kept["terminals"]]
    return Tables(kept["actions"], kept["start"], kept["end"], rules, terminals, kept["ignored"])
