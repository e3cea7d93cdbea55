"""The command line of every program: options, subcommands, help and errors have one form, which argparse parses.

A command is a value: what it does, a function that declares its options, a function that carries it out. A group
maps names to commands and loads the one that is called. Wrong usage is told the same way everywhere, on standard error
and with exit code 2:

    rmr sim: unknown option --see; did you mean '--seed'?
    usage: rmr sim [OPTIONS] LAB
    for more: rmr sim --help

argparse is used through its public interface. Three habits of it are replaced: it takes an abbreviated option for the
whole one; it takes a value that begins with a dash for an option; and it refuses positional words that stand on both
sides of an option. So the words are put into one order before it parses them: `--name=value` for each option, then
``--``, then the positional words.

What only help and wrong usage need is imported by them, so that all other commands start without it.
"""
# ruff: noqa: PLC0415 - see above

import argparse
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from rmr import __version__
from rmr.entry import ExitCode
from rmr.entry.completion import VARIABLE, DeclaredWords, complete
from rmr.entry.terminal import text_columns

DIGITS_MAX = 18
"""Digits of a whole number at most: what fits 64 bits, and far from where Python refuses to convert."""

Read = Callable[[str], Any]
"""Makes a value of an option's word. Raises ValueError with a sentence that says what to write."""


class CommandLineError(Exception):
    """Wrong usage: what is wrong, and what to do about it."""


class Runnable(Protocol):
    """A command, a group of commands, or another program."""

    def main(self, words: Sequence[str] | None = None, name: str = "rmr") -> int:
        """Carry out `words` (None: those of this process) as the command `name`; return the exit code."""
        ...


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """Return the hint with the name in `known` that is nearest to `wrong`; empty if none is near."""
    from difflib import get_close_matches

    names = list(known)
    near = [name for name in names if len(wrong) > 2 and name.startswith(wrong)] or get_close_matches(wrong, names, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


class Parser(argparse.ArgumentParser):
    """The options and positional words of one command."""

    def __init__(self, name: str, about: str, epilog: str = "") -> None:
        super().__init__(
            prog=name,
            formatter_class=partial(argparse.RawDescriptionHelpFormatter, width=text_columns() - 2),
            allow_abbrev=False,
        )
        self._about = about
        self._epilog = epilog
        self.declared = DeclaredWords()
        self.names = self.declared.names
        """Every option as it may be written -> its long name."""
        self._required: list[str] = []
        self._positional: list[str] = []
        self.add_argument(
            "--version", action="version", version=f"rmr (rmr-robots) {__version__}", help="show the version and exit"
        )

    # --- declaring

    def option(
        self,
        *names: str,
        metavar: str,
        help: str,  # noqa: A002 - argparse's word
        read: Read = str,
        default: Any = None,
        dest: str | None = None,
        required: bool = False,
        repeatable: bool = False,
    ) -> None:
        """Declare an option with a value, its long name last; a `repeatable` one gives a list.

        The help shows the default unless it is None.
        """
        shown = help if default is None else f"{help} (default: {default})"
        self.add_argument(
            *names,
            metavar=metavar,
            help=shown.replace("%", "%%"),
            type=_told(read),
            default=[] if repeatable else default,
            required=required,
            action="append" if repeatable else "store",
            dest=dest or _attribute(names[-1]),
        )
        self.names |= dict.fromkeys(names, names[-1])
        self.declared.metavars[names[-1]] = metavar
        self.declared.helps[names[-1]] = help
        if required:
            self._required.append(f"{names[-1]} {metavar}")

    def choice(self, name: str, values: Sequence[str], *, help: str, default: str | None = None) -> None:  # noqa: A002
        """Declare an option whose value is one of `values`."""
        self.option(name, metavar="|".join(values), help=help, read=one_of(values), default=default)

    def flag(self, *names: str, help: str, dest: str | None = None) -> None:  # noqa: A002
        """Declare an option without a value, its long name last."""
        self.add_argument(*names, action="store_true", help=help.replace("%", "%%"), dest=dest or _attribute(names[-1]))
        self.declared.helps[names[-1]] = help
        self.names |= dict.fromkeys(names, names[-1])

    def positional(
        self,
        dest: str,
        metavar: str,
        *,
        read: Read = Path,
        count: str | None = None,
        help: str = "",  # noqa: A002
        usage: str | None = None,
    ) -> None:
        """Declare a positional word; `count` as argparse's nargs, `usage` what the line of usage shows for it."""
        default: list[str] | None = [] if count == "*" else None  # without one argparse takes it for required
        self.add_argument(
            dest, metavar=metavar, type=_told(read), nargs=count, default=default, help=help.replace("%", "%%")
        )
        self.declared.words.append(metavar)
        self._positional.append(usage if usage is not None else metavar)

    def format_help(self) -> str:
        """Return the help text, as wide as the terminal."""
        self.description = _wrapped(self._about)
        self.epilog = _wrapped(self._epilog) or None
        return super().format_help()

    # --- parsing

    def read(self, words: Sequence[str]) -> argparse.Namespace:
        """Return the values of `words`; ``--help`` and ``--version`` end the process. Raises CommandLineError."""
        self.usage = self.usage_line()
        options, extra = self.parse_known_args(self._in_order(words))
        if unexpected := [word for word in extra if word != "--"]:
            raise CommandLineError(f"unexpected argument {unexpected[0]!r:.60}")
        return options

    def told(self, error: CommandLineError) -> str:
        """Return what a person is shown of wrong usage."""
        return f"{self.prog}: {error}\nusage: {self.usage_line()}\nfor more: {self.prog} --help\n"

    def error(self, message: str) -> Any:
        """Raise CommandLineError in place of argparse's own message and end."""
        if missing := re.fullmatch("the following arguments are required: (.*)", message):
            raise CommandLineError(f"missing: {missing[1]}")
        raise CommandLineError(message.removeprefix("argument "))

    def usage_line(self) -> str:
        """Return the command with what it must be given."""
        return " ".join([self.prog, *self._required, "[OPTIONS]", *self._positional])

    def _in_order(self, words: Sequence[str]) -> list[str]:
        """Return `words` with the options first, each in one word with its value."""
        options: list[str] = []
        positional: list[str] = []
        rest = iter(words)
        for word in rest:
            if word == "--":
                positional.extend(rest)
            elif word == "-" or not word.startswith("-"):
                positional.append(word)
            else:
                options.append(self._whole_option(word, rest))
        return [*options, "--", *positional] if positional else options

    def _whole_option(self, word: str, rest: Iterator[str]) -> str:
        """Return the option `word` in one word with its value, which is taken from `rest` if it is not in it."""
        if word.startswith("--"):
            written, equals, value = word.partition("=")
        else:
            written = word[:2]
            equals = word[2:]
            value = word[2:]
        name = self.names.get(written)
        if name is None:
            raise CommandLineError(f"unknown option '{written}'{did_you_mean(written, self.names)}")
        metavar = self.declared.metavars.get(name)
        if metavar is None:
            if equals:
                raise CommandLineError(f"{written} takes no value")
            return name
        if not equals:
            following = next(rest, None)
            if following is None:
                raise CommandLineError(f"{written} needs a value: {written} {metavar}")
            value = following
        return f"{name}={value}"


EXTRAS: Final = {
    "PIL": ("Pillow", "maps"),
    "cloudpickle": ("Dask", "cluster"),
    "cryptography": ("cryptography", "keys"),
    "distributed": ("Dask", "cluster"),
    "lsprotocol": ("pygls", "editor"),
    "matplotlib": ("matplotlib", "plot"),
    "pygls": ("pygls", "editor"),
    "websockets": ("websockets", "foxglove"),
}
"""Module that not every installation has -> its library, and the extra of rmr-robots that brings it."""


def remedy(error: ModuleNotFoundError) -> str:
    """Return which library is missing and what brings it, as one clause; empty where no extra of rmr-robots does."""
    library, extra = EXTRAS.get((error.name or "").partition(".")[0], ("", ""))
    return f"{library} is not installed; pip install 'rmr-robots[{extra}]' brings it" if extra else ""


class Command(NamedTuple):
    """One command."""

    about: str
    """What it does: paragraphs for its help."""
    declare: Callable[[Parser], None]
    """Declares its options and positional words."""
    perform: Callable[..., int | None]
    """Carries it out, given the values by name; returns the exit code. May raise CommandLineError."""
    epilog: str = ""

    def parser(self, name: str) -> Parser:
        """Return the parser of its words."""
        parser = Parser(name, self.about, self.epilog)
        self.declare(parser)
        return parser

    def main(self, words: Sequence[str] | None = None, name: str = "rmr") -> int:
        """Carry out `words` (None: those of this process) as the command `name`; return the exit code."""
        parser = self.parser(name)
        words = sys.argv[1:] if words is None else words
        if VARIABLE in os.environ:
            return complete(parser.declared, words)
        try:
            options = parser.read(words)
            return self.perform(**vars(options)) or ExitCode.OK
        except CommandLineError as error:
            print(parser.told(error), end="", file=sys.stderr)
            return ExitCode.USAGE
        except ModuleNotFoundError as error:
            if not (told := remedy(error)):
                raise
            print(f"{name}: {told}", file=sys.stderr)
            return ExitCode.FAILED


class Subcommand(NamedTuple):
    """A command of a group as the group's help lists it."""

    summary: str
    load: Callable[[], Runnable]
    """Imports and returns the command."""
    heading: str = ""
    """Under which the group lists it; in one order with its neighbours."""


class CommandGroup(NamedTuple):
    """A command whose first word names one of several commands."""

    about: str
    commands: Mapping[str, Subcommand]
    moved: Mapping[str, str] = {}
    """Commands that have gone -> what takes the place."""

    def main(self, words: Sequence[str] | None = None, name: str = "rmr") -> int:
        """Carry out `words` (None: those of this process) as the command `name`; return the exit code."""
        words = sys.argv[1:] if words is None else list(words)
        parser = Parser(name, self.about, self._listing())
        parser.positional("command", "COMMAND", usage="COMMAND ...", help=argparse.SUPPRESS)
        if VARIABLE in os.environ and len(words) < 2:
            return complete(parser.declared, words, {each: entry.summary for each, entry in self.commands.items()})
        if not words:
            parser.usage = parser.usage_line()
            parser.print_help(sys.stderr)
            return ExitCode.USAGE
        try:
            if words[0].startswith("-"):
                parser.read(words)
                raise CommandLineError("missing: COMMAND")
            if words[0] in self.moved:
                raise CommandLineError(f"{name} {words[0]} is now {self.moved[words[0]]}")
            if words[0] not in self.commands:
                raise CommandLineError(f"unknown command {words[0]!r}{did_you_mean(words[0], self.commands)}")
        except CommandLineError as error:
            print(parser.told(error), end="", file=sys.stderr)
            return ExitCode.USAGE
        return self.commands[words[0]].load().main(words[1:], f"{name} {words[0]}")

    def _listing(self) -> str:
        width = max(map(len, self.commands))
        lines: list[str] = []
        heading = None
        for name, entry in self.commands.items():
            if entry.heading != heading:
                heading = entry.heading
                lines += [*([""] if lines else []), f"{heading or 'commands'}:"]
            lines.append(f"  {name:{width}}  {entry.summary}")
        return "\n".join(lines)


# --- values


def whole(least: int = 0, most: int | None = None) -> Read:
    """Return the reader of a whole number from `least` to `most`, of 18 digits at most."""
    limit = f" to {most}" if most is not None else f", of {DIGITS_MAX} digits at most"

    def read(text: str) -> int:
        number = int(text) if re.fullmatch(f"-?[0-9]{{1,{DIGITS_MAX}}}", text, re.ASCII) else None
        if number is None or number < least or (most is not None and number > most):
            raise ValueError(f"a whole number from {least}{limit}, not {text!r:.40}")
        return number

    return read


def real(least: float = -math.inf, most: float = math.inf, *, above: bool = False) -> Read:
    """Return the reader of a number from `least` (or `above` it) to `most`."""
    low = "" if least == -math.inf else f" above {least:g}" if above else f" from {least:g}"
    limits = low + ("" if most == math.inf else f" to {most:g}")

    def read(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not least <= number <= most or (above and number == least):
            raise ValueError(f"a number{limits}, not {text!r:.40}")
        return number

    return read


def one_of(values: Sequence[str]) -> Read:
    """Return the reader of one of `values`."""

    def read(text: str) -> str:
        if text not in values:
            raise ValueError(f"one of {', '.join(values)}, not {text!r:.40}{did_you_mean(text, values)}")
        return text

    return read


def _attribute(name: str) -> str:
    """Return the name under which an option's value is passed on."""
    return name.lstrip("-").replace("-", "_")


def _told(read: Read) -> Read:
    """Return `read` such that argparse shows the sentence of a ValueError."""

    def told(text: str) -> Any:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return told


def _wrapped(text: str) -> str:
    """Return `text` with its paragraphs wrapped to the terminal; indented lines and lists of commands stay."""
    import textwrap

    width = text_columns() - 2
    paragraphs = text.split("\n\n")
    return "\n\n".join(each if "\n  " in each else textwrap.fill(" ".join(each.split()), width) for each in paragraphs)
