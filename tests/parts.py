"""The parts of the tests, a plugin of pytest: `deterministic`, and `real` for those that need the machine.

A real test starts processes, connects sockets or waits for a clock, so a busy machine may fail it; nothing but the
sources decides about a deterministic one. Real is what a marker calls so, what stands in `REAL_FOLDERS`, and the
modules of `REAL_MODULES`. A deterministic test that starts a process or uses a socket fails, whatever else it finds;
that none names a clock is held by `tests/architecture/test_parts.py`.

`tests/run_parts.py` runs the parts one after the other. With `RMR_TEST_TIMES` each run writes a line of JSON for each
test into that file: its name, what came of it, and its seconds.
"""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

TESTS = Path(__file__).parent
TIMES = "RMR_TEST_TIMES"
REAL_FOLDERS = frozenset({"integration", "page"})
REAL_MODULES = frozenset(
    {
        "architecture/test_console_scripts.py",
        "architecture/test_house_style.py",
        "architecture/test_import_rules.py",
        "architecture/test_parts.py",
        "architecture/test_tiers.py",
        "docs/test_doc_blocks.py",
        "eval/test_eval_columnar.py",
        "eval/test_eval_process.py",
        "evaluation/test_ablation.py",
        "evaluation/test_evaluation.py",
        "fuzz/test_fuzz_engines.py",
        "paper/test_vm_section_4.py",
        "properties/test_forged_messages.py",
        "properties/test_lang_growth.py",
        "properties/test_vm_order.py",
        "sim/test_command.py",
        "sim/test_hunt.py",
        "sim/test_labs.py",
        "sim/test_sim_api.py",
        "sim/test_sim_chaos.py",
        "sim/test_sim_recording.py",
        "unit/agent/test_late_samples.py",
        "unit/agent/test_robot_life.py",
        "unit/agent/test_robot_telling.py",
        "unit/agent/test_state_folder.py",
        "unit/bench/test_bench_cells.py",
        "unit/bus/test_bus_bridge.py",
        "unit/bus/test_bus_cells.py",
        "unit/bus/test_bus_parts.py",
        "unit/bus/test_bus_process.py",
        "unit/bus/test_bus_seats.py",
        "unit/bus/test_bus_secret.py",
        "unit/bus/test_bus_session.py",
        "unit/bus/test_rights.py",
        "unit/compiled/test_compiled.py",
        "unit/deploy/test_active_runs.py",
        "unit/deploy/test_exit_report.py",
        "unit/deploy/test_fault.py",
        "unit/deploy/test_fleet.py",
        "unit/deploy/test_full_disk.py",
        "unit/deploy/test_hostile_messages.py",
        "unit/deploy/test_launch.py",
        "unit/deploy/test_page_start.py",
        "unit/deploy/test_process_faults.py",
        "unit/deploy/test_process_group.py",
        "unit/deploy/test_restarts.py",
        "unit/docs/test_docs_pictures.py",
        "unit/editor/test_lsp.py",
        "unit/editor/test_vscode.py",
        "unit/lab/test_lab_check.py",
        "unit/lab/test_lab_new.py",
        "unit/lang/test_lang_functions.py",
        "unit/lang/test_lang_grammar.py",
        "unit/lang/test_lang_terminal.py",
        "unit/radio/test_radio_links.py",
        "unit/radio/test_radio_security.py",
        "unit/radio/test_radio_station.py",
        "unit/record/test_damaged_recordings.py",
        "unit/score/test_drawn_lab.py",
        "unit/test_cli.py",
        "unit/test_cli_output.py",
        "unit/test_explain.py",
        "unit/view/test_foxglove_npm_client.py",
        "unit/view/test_foxglove_server.py",
        "unit/view/test_page_clients.py",
        "unit/view/test_peer_owner.py",
        "unit/view/test_plot.py",
        "unit/view/test_recorded_source.py",
        "unit/view/test_run_pacer.py",
        "unit/view/test_view_command.py",
        "unit/view/test_web_app.py",
        "unit/world/test_world_report.py",
        "unit/world/test_world_server.py",
        "why/test_why_past.py",
    }
)
"""Modules of tests/ whose tests need the machine, or a fixture that does."""
LOST = "lost"
"""What came of a test that was collected and never ended, as its worker died."""

_WATCHED = {
    "os.exec": "executes a program",
    "os.fork": "starts a process",
    "os.posix_spawn": "starts a process",
    "os.system": "starts a process",
    "socket.bind": "opens a socket",
    "socket.connect": "connects a socket",
    "socket.getaddrinfo": "looks up an address",
    "subprocess.Popen": "starts a process",
}
"""The interpreter's audit events that a deterministic test may not raise."""
_seen: set[str] | None = None
"""What the present test has done of it; None: no deterministic test is under way."""


def _audit(event: str, _: tuple[Any, ...]) -> None:
    if _seen is not None and event in _WATCHED:
        _seen.add(_WATCHED[event])


sys.addaudithook(_audit)


@pytest.hookimpl(tryfirst=True)  # before `-m` selects
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the real tests."""
    for item in items:
        place = item.path.relative_to(TESTS) if item.path.is_relative_to(TESTS) else Path()
        if place.parts[:1] and (place.parts[0] in REAL_FOLDERS or place.as_posix() in REAL_MODULES):
            item.add_marker("real")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Watch a deterministic test, with its fixtures."""
    global _seen  # noqa: PLW0603  an audit hook stays for good
    _seen = None if item.get_closest_marker("real") else set()
    result = yield
    _seen = None
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Fail a deterministic test that has needed the machine."""
    result = yield
    if _seen:
        pytest.fail(f"it {' and '.join(sorted(_seen))}: mark it real, or list its module in tests/parts.py")
    return result


class TimesWriter:
    """Writes what came of each test, and how long it took, at the end of a run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._collected: set[str] = set()
        self._outcomes: dict[str, str] = {}
        self._seconds: dict[str, float] = {}

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Note what this process is to run."""
        self._collected.update(item.nodeid for item in session.items)

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        """Note what the workers are to run."""
        self._collected.update(ids)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Take in a phase of a test."""
        name = report.nodeid
        self._seconds[name] = self._seconds.get(name, 0.0) + report.duration
        if report.failed or (report.when == "call" and self._outcomes.get(name) != "failed"):
            self._outcomes[name] = report.outcome
        elif report.skipped:
            self._outcomes.setdefault(name, report.outcome)

    def pytest_sessionfinish(self) -> None:
        """Write the file."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("w") as file:
            for name in sorted(self._collected | set(self._outcomes)):
                line = {
                    "test": name,
                    "outcome": self._outcomes.get(name, LOST),
                    "s": round(self._seconds.get(name, 0.0), 3),
                }
                file.write(json.dumps(line) + "\n")


def pytest_configure(config: pytest.Config) -> None:
    """Write the times where somebody wants them, in the process that hears of all tests."""
    path = os.environ.pop(TIMES, "")  # it is not meant for what the tests start
    if path and not hasattr(config, "workerinput"):
        config.pluginmanager.register(TimesWriter(Path(path)))
