"""The routes of the page's server, and what they refuse."""

import json
import socket

import pytest
from served_page import ROBOTS, TOKEN, FilledSource, heard, served
from websockets.exceptions import InvalidStatus

from rmr_view.run_source import ENTRIES_MAX, WhyOptions


@pytest.fixture
def source():
    source = FilledSource()
    for i in range(5):
        source.history.add_poses(round(0.1 * i, 1), {robot: (robot + 0.1 * i, 1.0, 0.5) for robot in ROBOTS})
    source.history.add_estimate(0.2, 2, (2.0, 1.1, 0.4))
    source.history.add_entries("trace", [{"t": 0.1, "robot": 1, "what": "asks"}, {"t": 0.3, "robot": 1, "what": "at"}])
    source.history.add_entries("frames", [{"t": 0.2, "source": 1}])
    source.history.add_entries("routes", [{"t": 0.2, "robot": 1, "points": [[0, 0], [1, 1]]}])
    return source


@pytest.fixture
def browser(source):
    with served(source) as browser:
        yield browser


def test_index_and_static_files_forbid_everything_from_elsewhere(browser):
    status, content, headers = browser.fetch("/")
    assert (status, headers.get_content_type()) == (200, "text/html")
    assert b"<html" in content
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert (headers["X-Content-Type-Options"], headers["Referrer-Policy"]) == ("nosniff", "no-referrer")
    assert browser.fetch("/static/index.html")[0] == 200


@pytest.mark.parametrize("path", ["/static/../web_app.py", "/static/%2e%2e/web_app.py", "/static/", "/nix", "/api/nix"])
def test_paths_out_of_the_page_and_unknown_ones_are_not_found(browser, path):
    assert browser.fetch(path)[0] == 404


def test_run_names_lab_robots_and_rights(browser):
    assert browser.get("/api/run") == {
        "lab": "bench",
        "robots": [1, 2, 3],
        "live": True,
        "steer": True,
        "control": True,
    }


def test_poses_are_those_of_the_window_with_estimates_of_their_own_instants(browser):
    poses = browser.get("/api/poses?begin=0.1&end=0.3")
    assert poses["t"] == [0.1, 0.2, 0.3]
    assert poses["robots"]["2"] == {"x": [2.1, 2.2, 2.3], "y": [1.0] * 3, "heading": [0.5] * 3}
    assert poses["estimates"]["2"] == {"t": [0.2], "x": [2.0], "y": [1.1], "heading": [0.4]}
    assert poses["step"] == 1
    assert browser.get("/api/poses?begin=9")["t"] == []


def test_timeline_ends_open_intervals_at_the_newest_instant(browser):
    lanes = browser.get("/api/timeline")["lanes"]
    assert [lane["robot"] for lane in lanes] == [1, 2, 3]
    assert [(one["kind"], one["begin_s"], one["end_s"]) for one in lanes[0]["intervals"]] == [("asking", 0.1, 0.4)]


@pytest.mark.parametrize(("kind", "found"), [("trace", [0.3]), ("frames", [0.2]), ("log", []), ("routes", [0.2])])
def test_entries_are_those_of_the_window(browser, kind, found):
    answer = browser.get(f"/api/{kind}?begin=0.2&end=1e3")
    assert ([entry["t"] for entry in answer["entries"]], answer["more"]) == (found, False)


def test_entries_beyond_the_bound_are_announced_by_more(source, browser):
    source.history.add_entries("log", [{"t": i * 0.001, "message": ""} for i in range(ENTRIES_MAX + 2)])
    answer = browser.get("/api/log")
    assert (len(answer["entries"]), answer["more"]) == (ENTRIES_MAX, True)
    rest = browser.get(f"/api/log?begin={answer['entries'][-1]['t']}")
    assert (len(rest["entries"]), rest["more"]) == (3, False)


def test_robot_and_why_pass_their_question_on(source, browser):
    assert browser.get("/api/robot/3?t=1.5") == {"robot": 3, "t": 1.5}
    assert browser.get("/api/robot/3")["t"] is None
    assert browser.get("/api/why?robot=1&fact=at(@1,%20exit)&t=2&depth=5&more=3.17&not=1") == {
        "question": "at(@1, exit)"
    }
    assert source.asked == [(3, 1.5), (3, None), (1, "at(@1, exit)", 2.0, WhyOptions(True, 5, "3.17"))]


def test_missed_deadlines_are_asked_of_one_robot(source, browser):
    assert browser.get("/api/missed?robot=2") == {"delays": [], "problems": []}
    assert source.asked == [(2, "missed")]


def test_commands_of_a_step_pass_with_the_stop_from_which_they_go(source, browser):
    assert browser.get("/api/step?robot=2&at=4&do=break%2021%0Acontinue") == {"robot": 2, "at": 4}
    assert browser.get("/api/step?robot=2")["at"] == -1
    assert source.asked == [(2, 4, "break 21\ncontinue"), (2, -1, "")]


@pytest.mark.parametrize(
    ("path", "status", "words"),
    [
        ("/api/poses?begin=x", 400, "begin: write seconds of lab time from 0 on, such as 12.5, not 'x'"),
        ("/api/poses?begin=-1", 400, "begin: write seconds"),
        ("/api/poses?begin=nan", 400, "begin: write seconds"),
        ("/api/poses?end=inf", 400, "end: write seconds"),
        ("/api/poses?begin=3&end=2", 400, "begin comes after end"),
        ("/api/poses?from=3", 400, "unknown parameter 'from'; known are begin, end"),
        ("/api/poses?begin=1&begin=2", 400, "begin: write it once"),
        ("/api/timeline?t=3", 400, "unknown parameter 't'; this route has none"),
        ("/api/robot/9", 404, "there is no robot '9' in this run"),
        ("/api/robot/x", 400, "there is no robot 'x' in this run"),
        ("/api/robot/3?t=", 400, "t: write seconds"),
        ("/api/why?robot=1", 400, "fact: write a fact"),
        ("/api/why?fact=at(@1)", 400, "there is no robot '' in this run"),
        ("/api/why?robot=1&fact=nix(@1)", 400, "the program knows no fact `nix`"),
        ("/api/why?robot=1&fact=a&depth=-1", 400, "depth: write a whole number from 0 to 100"),
        ("/api/why?robot=1&fact=a&more=x", 400, "more: write the number"),
        ("/api/why?robot=1&fact=a&not=yes", 400, "not: write 1"),
        ("/api/step?robot=1&at=-2", 400, "at: write the number of a stop, or -1"),
        ("/api/step?robot=1&at=x", 400, "at: write the number of a stop"),
        ("/api/step?robot=9", 404, "there is no robot '9' in this run"),
        ("/api/step?robot=1&to=3", 400, "unknown parameter 'to'; known are robot, at, do"),
        (f"/api/step?robot=1&do={'x' * 20_001}", 400, "do: write commands of 20000 characters at most"),
        ("/api/missed", 400, "there is no robot '' in this run"),
        ("/api/missed?robot=1&job=a", 400, "unknown parameter 'job'; known are robot"),
    ],
)
def test_malformed_query_is_refused_with_a_sentence(browser, path, status, words):
    answer = browser.fetch(path)
    assert answer[0] == status
    assert answer[1]["error"].startswith(words)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1:1", ""])
def test_foreign_host_is_refused_against_dns_rebinding(browser, host):
    status, content, headers = browser.fetch("/api/run", Host=host)
    assert status == 403
    assert content["error"].startswith("this page answers only to the host names 127.0.0.1, localhost")
    assert "Content-Security-Policy" in headers


def test_localhost_is_a_name_of_the_page(browser):
    assert browser.fetch("/api/run", Host=f"localhost:{browser.port}")[0] == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:1", "http://127.0.0.1:1"])
def test_foreign_origin_is_refused_for_http_and_websocket(browser, origin):
    assert browser.fetch("/api/run", Origin=origin)[0] == 403
    assert browser.fetch("/api/control", b'{"do": "clear"}', Origin=origin, X_RMR_Token=TOKEN)[0] == 403
    with pytest.raises(InvalidStatus) as refused:
        browser.follow(origin=origin)
    assert refused.value.response.status_code == 403


def test_own_origin_may_follow(browser):
    with browser.follow(origin=browser.base) as following:
        assert heard(following, "clock")["t"] == 0.4


def test_orders_need_the_token(source, browser):
    assert browser.order(do="kill", robot=3) == (200, {"done": "kill"})
    for token in ("", "wrong", TOKEN + "x"):
        status, content = browser.order(token, do="kill", robot=3)
        assert (status, content["error"][:34]) == (403, "the token is missing or wrong: ope")
    assert browser.fetch("/api/control", b'{"do": "clear"}')[0] == 403
    assert browser.fetch("/api/control")[0] == 405
    assert source.orders == [{"do": "kill", "robot": 3}]


def test_orders_are_refused_without_control():
    source = FilledSource()
    with served(source, token=None) as browser:
        status, content = browser.order(do="clear")
    assert (status, content["error"]) == (403, "orders are refused: the page was started without --control")
    assert source.orders == []


@pytest.mark.parametrize(("order", "status"), [({"do": "pause"}, 409), ({"do": "kill", "robot": 1}, 403)])
def test_orders_that_the_run_does_not_take_are_refused(order, status):
    source = FilledSource(steer=False, control=False)
    with served(source) as browser:
        assert browser.order(**order)[0] == status
    assert source.orders == []


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "the order is no JSON"),
        (b"[" * 50_000, "the order is no JSON"),
        (b"[]", 'an order is a JSON object with the key "do"'),
        (b'{"do": "explode"}', "unknown order 'explode'; known are pause, resume, step"),
        (b'{"do": "kill"}', "kill: the field 'robot' is missing"),
        (b'{"do": "kill", "robot": 9}', "kill: robot: write the id of a robot of this run"),
        (b'{"do": "kill", "robot": true}', "kill: robot: write the id"),
        (b'{"do": "kill", "robot": 1, "hard": 1}', "kill: unknown field 'hard'"),
        (b'{"do": "loss", "loss": 1.5}', "loss: loss: write a number from 0 to 1"),
        (b'{"do": "loss", "loss": NaN}', "loss: loss: write a number from 0 to 1"),
        (b'{"do": "stall", "robot": 1, "for_s": -1}', "stall: for_s: write a number from 0.001"),
        (b'{"do": "speed", "speed": 1000}', "speed: speed: write a number from 0.1 to 100"),
        (b'{"do": "partition", "groups": [[1, 2]]}', "partition: groups: write two groups"),
        (b'{"do": "partition", "groups": [[1], [1]]}', "partition: groups: write two groups"),
        (b'{"do": "partition", "groups": [[1], [[2]]]}', "partition: groups: write the id"),
    ],
)
def test_malformed_order_is_refused_with_a_sentence(source, browser, body, words):
    status, content, _ = browser.fetch("/api/control", body, X_RMR_Token=TOKEN)
    assert status == 400
    assert content["error"].startswith(words)
    assert source.orders == []


def test_oversized_order_is_refused(browser):
    assert browser.fetch("/api/control", b" " * 70_000, X_RMR_Token=TOKEN)[0] == 413


def test_no_octets_of_a_client_reach_the_log_or_end_the_server(browser, capfd):
    for octets in (b"\0" * 100, b"GET / HTTP/9\r\n\r\n", b"GET /ws HTTP/1.1\r\nUpgrade: websocket\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", browser.port)) as raw:
            raw.sendall(octets)
            raw.shutdown(socket.SHUT_WR)
            while raw.recv(4096):
                pass
    assert browser.fetch("/api/run")[0] == 200
    assert capfd.readouterr() == ("", "")


def test_answers_hold_no_number_that_json_lacks(source, browser):
    source.history.add_entries("log", [{"t": 0.3, "value": float("inf")}])
    assert json.loads(json.dumps(browser.get("/api/log")["entries"])) == [{"t": 0.3, "value": None}]
