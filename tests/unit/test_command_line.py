"""The command line of every command: help, version, near misses, wrong usage; and the layer that they share."""

import ast
import re
from pathlib import Path

import pytest
from command_runner import invoke

from rmr import __version__
from rmr.commands import subcommands
from rmr.commands.compile_command import command as rmrc
from rmr.commands.completion_command import SCRIPTS
from rmr.entry import ExitCode
from rmr.entry.command_line import Command, CommandGroup, did_you_mean, one_of, real, whole
from rmr.entry.completion import FILES, VARIABLE
from rmr_agent.main import command as agent
from rmr_deploy.doctor import command as doctor
from rmr_deploy.export import command as export
from rmr_deploy.fault import command as fault
from rmr_deploy.fleet import VERBS
from rmr_deploy.fleet import command as fleet
from rmr_deploy.keys_program import command as keys
from rmr_deploy.load import command as load
from rmr_deploy.router import command as router
from rmr_deploy.sign import command as sign
from rmr_deploy.up import command as up
from rmr_deploy.up import demo_command
from rmr_deploy.why_program import why_command
from rmr_editor.main import command as lsp
from rmr_lab.main import command as lab
from rmr_lab.main import new
from rmr_sim.main import command as sim
from rmr_sim.main import sweep_command
from rmr_view.plot import command as plot
from rmr_view.view import command as view
from rmr_world.main import command as world

ROOT = Path(__file__).parents[2]
PROGRAMS = {
    "rmr": subcommands.command,
    "rmrc": rmrc,
    "rmr-agent": agent(),
    "rmr-world": world(),
    "rmr sim": sim(),
    "rmr sweep": sweep_command(),
    "rmr up": up(),
    "rmr demo": demo_command(),
    "rmr doctor": doctor,
    "rmr export": export(),
    "rmr fault": fault(),
    "rmr fleet": fleet(),
    "rmr keys": keys(),
    "rmr load": load(),
    "rmr router": router(),
    "rmr sign": sign(),
    "rmr lab": lab,
    "rmr lsp": lsp,
    "rmr new": new,
    "rmr plot": plot(),
    "rmr view": view(),
    "rmr why": why_command(),
}


def below(name, command):
    """Yield a command and all of its subcommands in this process, by name."""
    yield name, command
    if isinstance(command, CommandGroup):
        for word, entry in command.commands.items():
            found = entry.load()
            if isinstance(found, Command | CommandGroup):
                yield from below(f"{name} {word}", found)


EVERY = dict(pair for name, command in PROGRAMS.items() for pair in below(name, command))
GROUPS = {name: command for name, command in EVERY.items() if isinstance(command, CommandGroup)}
SINGLE = {name: command for name, command in EVERY.items() if isinstance(command, Command)}


def call(name, *words):
    return invoke(EVERY[name], words, name=name)


def test_the_table_of_this_test_has_every_console_script_and_every_subcommand():
    scripts = re.findall(r'^(rmr[a-z-]*) = "', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert {name for name in PROGRAMS if " " not in name} == set(scripts)
    others = {*subcommands.PROGRAMS, "fleet"} - {"agent", "world"}
    assert {name for name in PROGRAMS if " " in name} == {f"rmr {name}" for name in others}
    assert {f"rmr {name}" for name in subcommands.COMMANDS} < set(EVERY)
    assert len(EVERY) > 30


def test_verbs_of_a_fleet_are_subcommands_of_rmr_with_the_same_summary():
    assert {name: summary for name, (summary, _, _) in VERBS.items()} == subcommands.FLEET


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_every_command_explains_itself(name, option):
    answer = call(name, option)
    assert (answer.exit_code, answer.stderr) == (0, "")
    assert answer.stdout.startswith(f"usage: {name} ")
    assert re.search(r"^  --version +show the version and exit$", answer.stdout, re.MULTILINE)
    assert max(map(len, answer.stdout.splitlines())) <= 100


@pytest.mark.parametrize("name", EVERY)
def test_every_command_tells_its_version(name):
    answer = call(name, "--version")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, f"rmr (rmr-robots) {__version__}\n", "")


@pytest.mark.parametrize("name", EVERY)
def test_an_unknown_option_gets_a_near_miss_and_the_usage(name):
    answer = call(name, "--versoin")
    assert (answer.exit_code, answer.stdout) == (2, "")
    first, usage, more = answer.stderr.splitlines()
    assert first == f"{name}: unknown option '--versoin'; did you mean '--version'?"
    assert usage.startswith(f"usage: {name} ")
    assert more == f"for more: {name} --help"


@pytest.mark.parametrize("name", EVERY)
def test_every_option_of_a_command_is_the_near_miss_of_its_own_misspelling(name):
    shown = call(name, "--help").stdout
    for option in re.findall(r"^  (?:-\w \S+, )?(--[a-z-]{4,})", shown, re.MULTILINE):
        told = call(name, f"{option}x").stderr
        assert told.startswith(f"{name}: unknown option '{option}x'; did you mean '{option}'?\n")


@pytest.mark.parametrize("name", EVERY)
def test_an_unknown_option_like_no_other_is_wrong_usage_without_a_near_miss(name):
    answer = call(name, "--qqqqqqqq=7")
    assert answer.exit_code == 2
    assert answer.stderr.startswith(f"{name}: unknown option '--qqqqqqqq'\n")


@pytest.mark.parametrize(
    ("name", "word"), [(name, word) for name, group in GROUPS.items() for word in group.commands], ids=" ".join
)
def test_a_misspelt_subcommand_gets_a_near_miss(name, word):
    answer = call(name, f"{word}q")
    assert (answer.exit_code, answer.stdout) == (2, "")
    assert answer.stderr.startswith(f"{name}: unknown command '{word}q'; did you mean '{word}'?\nusage: {name} ")


def test_a_command_that_has_gone_says_what_takes_its_place():
    for name, word, place in (("rmr", "top", "rmr stats"), ("rmr lab", "check", "rmr check")):
        answer = call(name, word, "x")
        assert (answer.exit_code, answer.stdout) == (2, "")
        assert answer.stderr.startswith(f"{name}: {name} {word} is now {place}\n")


def test_the_help_lists_every_command_under_a_heading():
    listed = [word for words in subcommands.HEADINGS.values() for word in words.split()]
    assert sorted(listed) == sorted({**subcommands.COMMANDS, **subcommands.PROGRAMS, **subcommands.FLEET})
    shown = call("rmr", "--help").stdout
    at = [shown.index(f"\n{heading}:\n  {words.split()[0]} ") for heading, words in subcommands.HEADINGS.items()]
    assert at == sorted(at)
    assert "\ncommands:\n" in call("rmr keys", "--help").stdout


@pytest.mark.parametrize("name", GROUPS)
def test_a_group_without_a_subcommand_lists_them_and_ends_as_wrong_usage(name):
    answer = call(name)
    assert (answer.exit_code, answer.stdout) == (2, "")
    assert all(re.search(rf"^  {word} ", answer.stderr, re.MULTILINE) for word in GROUPS[name].commands)


@pytest.mark.parametrize("name", ["rmr up", "rmr sim", "rmr check"])
def test_a_misspelt_lab_gets_a_near_miss(name):
    answer = call(name, "coridor")
    assert answer.exit_code == 2
    assert answer.stderr.startswith(f"{name}: LAB: there is no coridor; did you mean 'corridor'?\nusage: {name} ")


def test_what_is_missing_is_named_with_the_usage():
    assert call("rmr-agent").stderr.startswith(
        "rmr-agent: missing: --id\nusage: rmr-agent --id N [OPTIONS] [PROG.rbc]\n"
    )


def test_the_router_of_a_world_is_one_of_two():
    answer = call("rmr-world", "--config", "x", "--listen", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2")
    assert (answer.exit_code, answer.stderr.splitlines()[0]) == (
        2,
        "rmr-world: --connect is not allowed with --listen: name one of them",
    )


@pytest.mark.parametrize("listen", ["tcp/0.0.0.0:1", "tcp/[::]:1", "udp/192.0.2.7:1", "ws/lab-host:1"])
def test_a_world_beyond_loopback_without_a_secret_is_refused_unless_it_is_opened_on_purpose(listen):
    answer = call("rmr-world", "--config", "nowhere", "--listen", listen)
    assert answer.exit_code == 2
    assert answer.stderr.startswith(f"rmr-world: whoever reaches {listen}, from other machines, too, could drive")
    assert "--secret FILE" in answer.stderr
    for more in (("--open",), ("--secret", "nowhere.secret")):
        answer = call("rmr-world", "--config", "nowhere", "--listen", listen, *more)
        assert "could drive" not in answer.stderr


@pytest.mark.parametrize("listen", ["tcp/127.0.0.1:1", "tcp/127.8.0.1:1", "tcp/[::1]:1", "tcp/localhost:1"])
def test_a_world_on_loopback_needs_no_secret_and_is_not_opened(listen):
    assert "could drive" not in call("rmr-world", "--config", "nowhere", "--listen", listen).stderr
    answer = call("rmr-world", "--config", "nowhere", "--listen", listen, "--open")
    assert answer.stderr.splitlines()[0] == "rmr-world: --open goes with --listen beyond this machine alone"
    answer = call("rmr-world", "--config", "nowhere", "--listen", listen, "--open", "--secret", "x")
    assert answer.stderr.splitlines()[0] == "rmr-world: --open goes without --secret"


# --- completion


@pytest.fixture
def completed(monkeypatch):
    """Return what may take the last word's place, value -> help."""
    monkeypatch.setenv(VARIABLE, "1")

    def complete(name, *words):
        answer = call(name, *words)
        assert (answer.exit_code, answer.stderr) == (0, "")
        return dict((*line.split("\t"), "")[:2] for line in answer.stdout.splitlines())

    return complete


@pytest.mark.parametrize("name", EVERY)
def test_every_option_of_a_command_is_completed_with_its_help(name, completed, monkeypatch):
    found = completed(name, "--")
    monkeypatch.delenv(VARIABLE)
    shown = re.findall(r"^  (?:-\w(?: \S+)?, )?(--[a-z0-9-]+)", call(name, "--help").stdout, re.MULTILINE)
    assert sorted(found) == sorted(shown)
    assert all(found.values())


@pytest.mark.parametrize("name", GROUPS)
def test_the_commands_of_a_group_are_completed_with_their_summaries(name, completed):
    assert completed(name, "") == {word: entry.summary for word, entry in GROUPS[name].commands.items()}


def test_words_are_completed_where_the_cursor_stands(completed):
    assert completed("rmr", "sim") == {"sim": subcommands.PROGRAMS["sim"][1]}
    assert completed("rmr", "check", "te") == {"testbed": "a provided lab", FILES: ""}
    assert set(completed("rmr", "sim", "--seed", "3", "--see")) == {"--seed", "--seeds"}
    assert completed("rmr", "sim", "--seed", "") == completed("rmr", "sim", "--seed=") == {}
    assert set(completed("rmr-agent", "--durability", "p")) == {"process", "power"}
    assert set(completed("rmr-agent", "--durability=p")) == {"--durability=process", "--durability=power"}
    assert set(completed("rmr-agent", "--durability", "=", "p")) == {"process", "power"}, "as bash parts the words"
    assert set(completed("rmr-agent", "--durability", "=")) == {"process", "power"}
    assert set(completed("rmr radio overlap", "--interference", "a")) == {"awgn"}
    assert completed("rmrc", "x") == completed("rmrc", "-o", "x") == completed("rmrc", "--", "--x") == {FILES: ""}
    assert completed("rmr up", "corridor", "--seed", "--robots", "")[FILES] == "", "--robots is the value of --seed"
    assert set(completed("rmr completion", "")) == set(SCRIPTS)


# --- the layer that they share


def given(*words):
    """Return the values of `words` for a command with options of every kind, or what is wrong with them."""
    got = {}

    def declare(parser):
        parser.positional("first", "FIRST", read=str)
        parser.positional("others", "OTHER", read=str, count="*", usage="[OTHER...]")
        parser.option("-o", "--output", metavar="FILE", help="100 %")
        parser.option("--number", metavar="N", read=whole(1, 9), help="a number", default=3)
        parser.option("--fact", dest="facts", metavar="F", help="repeatable", repeatable=True)
        parser.choice("--kind", ["good", "bad"], help="which")
        parser.flag("--quick-run", help="a flag")

    answer = invoke(Command("About.", declare, lambda **values: got.update(values)), words, name="x")
    return got if answer.exit_code == 0 else answer.stderr.splitlines()[0].removeprefix("x: ")


def test_positional_words_and_options_may_come_in_any_order():
    expected = given("a", "b", "c", "--number", "4", "--quick-run")
    assert expected == {
        "first": "a",
        "others": ["b", "c"],
        "output": None,
        "number": 4,
        "facts": [],
        "kind": None,
        "quick_run": True,
    }
    assert given("--number=4", "a", "--quick-run", "b", "c") == expected
    assert given("a", "--quick-run", "b", "--number", "4", "c") == expected


def test_a_value_may_begin_with_a_dash_and_hold_anything():
    assert given("a", "--output", "-x y")["output"] == "-x y"
    assert given("a", "-o", "--quick-run")["output"] == "--quick-run"
    assert given("a", "-o=b")["output"] == "=b"
    assert given("a", "-ofile")["output"] == "file"
    assert given("a", "--output=")["output"] == ""
    assert given("a", "--fact", "1s: p(@1)", "--fact", "-2")["facts"] == ["1s: p(@1)", "-2"]


def test_after_two_dashes_every_word_is_positional():
    values = given("--number", "4", "--", "--number", "-o")
    assert (values["first"], values["others"], values["number"]) == ("--number", ["-o"], 4)
    assert given("-")["first"] == "-"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["a", "--numb", "4"], "unknown option '--numb'; did you mean '--number'?"),
        (["a", "-x"], "unknown option '-x'"),
        (["a", "--number"], "--number needs a value: --number N"),
        (["a", "--number", "10"], "--number: a whole number from 1 to 9, not '10'"),
        (["a", "-o"], "-o needs a value: -o FILE"),
        (["a", "--quick-run=1"], "--quick-run takes no value"),
        (["a", "--kind", "goood"], "--kind: one of good, bad, not 'goood'; did you mean 'good'?"),
        ([], "missing: FIRST"),
    ],
)
def test_wrong_usage_says_what_is_wrong_and_what_to_write(words, told):
    assert given(*words) == told


def test_a_word_too_many_is_named():
    answer = call("rmr-world", "--config", "lab.yaml", "again")
    assert answer.stderr.startswith("rmr-world: unexpected argument 'again'\n")


@pytest.mark.parametrize("text", ["1.0", "0x1", " 1", "\u0661", "1" * 19, "", "-1", "1_0"])
def test_a_whole_number_is_written_in_ascii_digits(text):
    with pytest.raises(ValueError, match="a whole number from 0, of 18 digits at most"):
        whole()(text)


def test_a_number_is_within_its_limits_and_never_nan():
    assert (real(0, 1)("0"), real(0, 1)("1"), real()("-1e3")) == (0.0, 1.0, -1000.0)
    for read, text in ((real(0, 1), "1.1"), (real(0, above=True), "0"), (real(), "nan"), (real(), "x")):
        with pytest.raises(ValueError, match=r"a number.*, not "):
            read(text)


def test_a_near_miss_prefers_the_whole_word_of_an_abbreviation():
    assert did_you_mean("--see", ["--json", "--seed"]) == "; did you mean '--seed'?"
    assert did_you_mean("zzz", ["--json", "--seed"]) == ""
    assert one_of(["a"])("a") == "a"


# --- exit codes


def test_the_table_in_the_documentation_has_the_exit_codes_of_the_code():
    page = (ROOT / "docs/labs.md").read_text()
    rows = re.findall(r"^\| (\d) \| (.*) \|$", page[page.index("Exit codes are the same everywhere") :], re.MULTILINE)
    assert [int(code) for code, meaning in rows[: len(ExitCode)] if meaning] == list(ExitCode)


def constants(tree):
    """Yield the names to which a module assigns, and the numbers with which it ends a process."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            yield from map(ast.unparse, node.targets)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("sys.exit", "os._exit"):
            yield from (ast.unparse(node) for each in node.args if isinstance(each, ast.Constant) and each.value)


def test_no_module_has_exit_codes_of_its_own():
    paths = [path for folder in ("rmr", "agents", "world", "deploy") for path in sorted((ROOT / folder).rglob("*.py"))]
    names = {str(path): list(constants(ast.parse(path.read_text()))) for path in paths}
    pattern = re.compile(r"\bEXIT_(OK|FAILED|USAGE|INVALID|STRICT)\b|exit\(")
    found = {file: [name for name in each if pattern.search(name)] for file, each in names.items()}
    assert len(found) > 200
    assert {file: own for file, own in found.items() if own} == {}
