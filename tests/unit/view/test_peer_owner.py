"""Other users of the machine may not look at a run."""

import os
import socket
import sys

import pytest
from served_page import FilledSource, served

from rmr_view import access_guard
from rmr_view.access_guard import is_stranger, owner_of

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not access_guard.SOCKET_TABLE.exists(), reason="needs the table of sockets"
)


def test_socket_of_this_user_is_found_and_is_no_stranger():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as client:
            host, own = client.getsockname()
            assert owner_of(host, own, port) == os.geteuid()
            assert not is_stranger(host, own, port)
            assert owner_of(host, own, port + 1) is None
    assert owner_of("no address", 1, port) is None


def test_client_of_another_user_is_refused(monkeypatch):
    with served(FilledSource()) as browser:
        assert browser.fetch("/api/run")[0] == 200
        monkeypatch.setattr(access_guard, "owner_of", lambda *_: os.geteuid() + 4711)
        status, content, _ = browser.fetch("/api/run")
        assert (status, content["error"]) == (403, "this page belongs to another user of this machine")
        with pytest.raises(Exception, match="403"):
            browser.follow().__enter__()
