"""Shell completion: what may stand at the cursor, for every program, from the options that its command declares.

A shell's script (`rmr.commands.completion_command`) calls the program itself with the words up to the cursor and
`VARIABLE` in the environment. The command that would carry them out then prints what may take the last word's place,
one a line, each with a tab and its help; the line `FILES` says that a path may, too. Nothing else is printed, and
nothing is carried out.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module

VARIABLE = "RMR_COMPLETE"
FILES = ":files"


@dataclass
class DeclaredWords:
    """The options and positional words of one command, by name."""

    names: dict[str, str] = field(
        default_factory=lambda: {"-h": "--help", "--help": "--help", "--version": "--version"}
    )
    """Every option as it may be written -> its long name."""
    metavars: dict[str, str] = field(default_factory=dict)
    """The long name of every option that takes a value -> what stands for the value in the help."""
    helps: dict[str, str] = field(default_factory=lambda: {"--help": "show the help", "--version": "show the version"})
    """The long name of every option -> its help."""
    words: list[str] = field(default_factory=list)
    """What stands for the positional words in the help."""


def complete(declared: DeclaredWords, words: Sequence[str], commands: Mapping[str, str] | None = None) -> int:
    """Print what may take the place of the last of `words`; return the exit code.

    `commands` are those of a group, with their summaries.
    """
    *before, current = _as_words(words)
    option = _open_option(declared, before)
    prefix = ""
    if option is None and current.startswith("--") and "=" in current:
        option = current.partition("=")[0]
        prefix = f"{option}="
    if option is not None:
        found = _values(declared.metavars.get(option, ""))
    elif current.startswith("-") and "--" not in before:
        found = iter(sorted((name, declared.helps.get(long, "")) for name, long in declared.names.items()))
    elif commands is not None:
        found = iter(commands.items())
    else:
        found = _values(" ".join(declared.words))
    for value, told in found:
        if value == FILES:
            print(FILES)
        elif f"{prefix}{value}".startswith(current):
            print(f"{prefix}{value}\t{told.splitlines()[0] if told else ''}".rstrip())
    return 0


def _as_words(words: Sequence[str]) -> list[str]:
    """Return `words` as they were typed, the last one empty where none is begun: bash takes `=` for a word."""
    return [word for word in words if word != "="] + ([""] if not words or words[-1] == "=" else [])


def _open_option(declared: DeclaredWords, before: Sequence[str]) -> str | None:
    """Return the long name of the option whose value is the next word, if there is one."""
    option = None
    for word in before:
        name = declared.names.get(word) if option is None else None
        option = name if name in declared.metavars else None
    return option


def _values(metavar: str) -> Iterator[tuple[str, str]]:
    """Yield what may be written for a value that the help calls `metavar`."""
    if re.fullmatch(r"[a-z0-9_-]+(\|[a-z0-9_-]+)+", metavar):
        yield from ((value, "") for value in metavar.split("|"))
    if "LAB" in metavar:
        # By its name, for labs are none of this package's business.
        yield from ((name, "a provided lab") for name in import_module("rmr_world.provided_labs").provided_labs())
    if re.search("FILE|DIR|LAB|RUN|PROG|PATH", metavar):
        yield FILES, ""
