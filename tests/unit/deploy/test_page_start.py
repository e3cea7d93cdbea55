"""The page of `rmr up`: when there is one, and that nothing is started before somebody opens it."""

import asyncio
import socket
import sys
from types import SimpleNamespace

import pytest

from rmr_deploy.page_start import PageStart, open_page


def plan(tmp_path, **options):
    known = {"view": False, "no_view": False, "port": None, "control": False, "as_json": False} | options
    return SimpleNamespace(options=SimpleNamespace(**known), folder=tmp_path, logs=tmp_path)


def opened(tmp_path, **options):
    """Return the page that a run has, and what was said."""
    said = []

    async def run():
        page = open_page(plan(tmp_path, **options), said.append)
        if page is not None:
            assert page.process is None
            page.close()
        return page

    return asyncio.run(run()), said


@pytest.mark.parametrize(
    ("options", "terminal", "shown"),
    [
        ({}, False, False),
        ({}, True, True),
        ({"as_json": True}, True, False),
        ({"as_json": True, "view": True}, False, True),
        ({"view": True}, False, True),
        ({"control": True}, False, True),
        ({"port": 0}, False, True),
        ({"no_view": True}, True, False),
    ],
)
def test_page_is_there_where_it_is_asked_for_or_a_person_looks(tmp_path, monkeypatch, options, terminal, shown):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal, raising=False)
    page, said = opened(tmp_path, **options)
    assert (page is not None) == shown
    assert len(said) == shown
    assert all(line.startswith("the page: http://127.0.0.1:") for line in said)
    assert all(("#token=" in line) == options.get("control", False) for line in said)


def test_port_in_use_is_told_and_the_run_goes_on(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        page, said = opened(tmp_path, view=True, port=port)
    assert page is None
    assert said == [f"no page: port {port}: Address already in use; choose another one with --port"]


@pytest.mark.medium
def test_first_connection_starts_the_server_which_inherits_the_socket(tmp_path):
    async def run():
        page = PageStart(tmp_path, tmp_path / "page.out")
        page.watch()
        await asyncio.sleep(0.05)
        assert page.process is None
        port = int(page.address.rsplit(":", 1)[1].strip("/"))
        _, writer = await asyncio.open_connection("127.0.0.1", port)
        while page.process is None:
            await asyncio.sleep(0.01)
        page.close()
        writer.close()
        return page.process

    process = asyncio.run(run())
    assert process.wait(30) == 3  # there is no run in this folder
    assert "no recording of a run" in (tmp_path / "page.out").read_text()
