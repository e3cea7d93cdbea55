"""The page of a run that is over: floor, slider, timeline, facts, program, keyboard."""

import pytest
from shown_run import until


@pytest.fixture
def page(over, visit):
    driver = visit(over.address)
    until(lambda: driver.state("report"), "the run is over")
    driver.pause()
    return driver


def distance(a, b):
    return ((a["x"] - b["x"]) ** 2 + (a["y"] - b["y"]) ** 2) ** 0.5


def test_map_moves_while_playing_and_stands_while_paused(over, visit):
    page = visit(over.address)
    page.seek(6.0)
    page.pause()
    before = until(page.robots, "robots")
    assert sorted(before) == [1, 2, 3, 4, 5, 6]
    drawn = page.read("frames")
    until(lambda: page.read("frames") > drawn + 5, "more frames")
    assert page.robots() == before
    page.press(" ")
    until(lambda: any(distance(pose, before[robot]) > 0.05 for robot, pose in page.robots().items()), "a robot moves")
    assert page.t > 6.0


def test_slider_shows_the_poses_of_its_instant(page, over):
    for t in (3.0, 12.34, 19.9, 0.0):
        page.seek(t)
        told = until(page.robots, "robots")
        for robot, pose in told.items():
            low, high = (over.source.history.pose(robot, round(at, 3))[0] for at in (t + 1e-6, t + 0.1))
            assert min(low[0], high[0]) - 1e-3 <= pose["x"] <= max(low[0], high[0]) + 1e-3
            assert min(low[1], high[1]) - 1e-3 <= pose["y"] <= max(low[1], high[1]) + 1e-3


def test_poses_between_samples_are_interpolated(page):
    def x_at(t):
        page.seek(t)
        return page.robots()[2]["x"]

    first, middle, last = x_at(8.0), x_at(8.05), x_at(8.1)
    assert first < middle < last
    assert middle == pytest.approx((first + last) / 2, abs=1e-4)


def test_click_on_a_robot_shows_its_facts_of_that_instant(page):
    page.seek(5.0)
    page.click_robot(3)
    until(lambda: page.state("selected") == 3, "robot 3 is chosen")
    facts = page.page.locator(".facts .fact code")
    held = ["!due(@3, 30.0)", "waiting(@3)", "turn(@3, crossing, 4)"]
    until(lambda: facts.all_inner_texts() == held, "its facts, the sensed ones last")
    panel = page.page.locator("#panel")
    assert "lineup(@3, entry, 4)" in panel.inner_text()
    assert "corridor.rmr:21" in panel.inner_text()
    page.seek(0.01)
    until(lambda: "lineup(@3, entry, 4)" not in panel.inner_text(), "what it knew and did at the begin")
    assert "corridor.rmr:21" not in panel.inner_text()


def test_rule_that_fired_leads_to_its_line_of_the_program(page):
    page.press("3")
    page.seek(5.0)
    page.page.locator("button.place", has_text="corridor.rmr:21").first.click()
    chosen = page.page.locator(".line.chosen")
    until(lambda: chosen.count() == 1, "the line")
    assert "lineup(R, entry, K)" in chosen.inner_text()
    assert page.page.get_by_role("tab", name="Program").get_attribute("aria-selected") == "true"


def test_click_in_the_timeline_seeks_and_chooses_the_robot_of_the_lane(page):
    x = page.ask("t => window.__rmr.timeAt(t)", 9.0)
    page.canvas("timeline").click(position={"x": x, "y": 40})
    until(lambda: abs(page.t - 9.0) < 0.1, "the instant")
    assert page.state("selected") == 1


def test_timeline_zooms_by_wheel_and_shows_everything_again(page):
    begin, end = page.read("window")
    assert begin == 0.0
    assert end > 34.0  # the last deadline, though the run is over before
    box = page.canvas("timeline").bounding_box()
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    page.page.mouse.wheel(0, -600)
    until(lambda: page.read("window")[1] - page.read("window")[0] < 0.7 * (end - begin), "a narrower window")
    page.press("f")
    until(lambda: page.read("window") == [begin, end], "the whole run")


def test_floor_pans_and_zooms_by_mouse_and_keys(page):
    view = page.read("view")
    box = page.canvas("floor").bounding_box()
    x, y = box["x"] + 200, box["y"] + 200
    page.page.mouse.move(x, y)
    page.page.mouse.wheel(0, -300)
    until(lambda: page.read("view")["scale"] > 1.2 * view["scale"], "closer")
    near = page.read("view")
    page.page.mouse.down()
    page.page.mouse.move(x + 60, y + 30, steps=6)
    page.page.mouse.up()
    until(lambda: page.read("view")["x"] < near["x"], "the view has moved")
    page.canvas("floor").focus()
    moved = page.read("view")
    page.press("ArrowRight")
    until(lambda: page.read("view")["x"] > moved["x"], "panned by a key")
    page.press("-")
    until(lambda: page.read("view")["scale"] < moved["scale"], "zoomed out by a key")
    page.press("f")
    until(lambda: page.read("view") == view, "the whole floor")


def test_floor_zooms_by_two_fingers(over, visit):
    page = visit(over.address, has_touch=True)
    page.pause()
    view = page.read("view")
    session = page.context.new_cdp_session(page.page)
    box = page.canvas("floor").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def touch(kind, *places):
        points = [{"x": x + dx, "y": y, "id": number} for number, dx in enumerate(places)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", -30, 30)
    for away in range(35, 95, 10):
        touch("touchMove", -away, away)
    touch("touchEnd")
    until(lambda: page.read("view")["scale"] > 1.5 * view["scale"], "zoomed")


def test_keys_play_seek_choose_and_help(page):
    page.press("Home")
    until(lambda: page.t == 0.0, "the begin")
    page.press("ArrowRight", "ArrowRight", "ArrowLeft")
    until(lambda: abs(page.t - 0.5) < 1e-6, "one step on")
    page.press("Shift+ArrowRight")
    until(lambda: abs(page.t - 5.5) < 1e-6, "a long step")
    page.press("End")
    until(lambda: page.t == page.read("end"), "the end")
    page.press("4")
    until(lambda: page.state("selected") == 4, "robot 4")
    page.press("n")
    until(lambda: page.state("selected") == 5, "robot 5")
    page.press("Escape")
    until(lambda: page.state("selected") is None, "no robot")
    page.press("?")
    assert page.page.get_by_role("dialog", name="Keys").is_visible()
    signs = page.page.locator("dialog .signs").inner_text()
    assert all(word in signs for word in ("asks", "waits", "claims", "inside", "drives", "stalled", "dead", "stopped"))
    box = page.page.locator("dialog").bounding_box()
    assert box["y"] >= 0
    assert box["y"] + box["height"] <= 800, "all of it is in sight, or scrolls"
    page.ask(
        """() => new MutationObserver(() => (window.focusAtClose = document.activeElement.tagName)).observe(
            document.querySelector("dialog"), {attributeFilter: ["open"]})"""
    )
    page.press("Escape")
    until(lambda: not page.page.locator("dialog").is_visible(), "the help is closed")
    assert page.ask("() => window.focusAtClose") == "BODY", "the next space is not for a button that is hidden"
    page.press("e")
    until(lambda: page.state("layers")["estimates"], "estimates")
    page.press("Home", " ")
    until(lambda: page.read("playing") and page.t > 0.1, "it plays")


def test_focus_is_visible_and_reaches_every_control(page):
    page.press("Home")
    until(lambda: page.state("nowSlow") == 0.0, "the begin")
    seen = set()
    for _ in range(60):
        page.press("Tab")
        focus = page.ask(
            "() => { const e = document.activeElement; const s = getComputedStyle(e); return ["
            "e.getAttribute('aria-label') || e.textContent.trim() || e.tagName,"
            "s.outlineStyle, parseFloat(s.outlineWidth)]; }"
        )
        if focus[0].startswith("Loading") or page.ask("() => document.activeElement === document.body"):
            break
        assert focus[1] != "none", focus
        assert focus[2] >= 1, focus
        seen.add(focus[0])
    for wanted in ("Time", "Play", "Help", "Trails", "Robot 1, free", "Zoom in"):
        assert wanted in seen, (wanted, seen)


def test_every_control_has_a_name(page):
    nameless = page.ask(
        "() => [...document.querySelectorAll('button, input, select, canvas, [role]')].filter(e => !e.hidden && "
        "!['listitem', 'group', 'treeitem', 'tooltip', 'status'].includes(e.getAttribute('role')) && "
        "!(e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.textContent.trim() || "
        "e.labels?.length)).map(e => e.outerHTML.slice(0, 120))"
    )
    assert nameless == []


@pytest.mark.parametrize("width", [320, 390, 699])
def test_narrow_screen_has_one_column_and_nothing_overflows(over, visit, width):
    page = visit(over.address, width=width, height=760)
    for tab in ("Robot", "Radio", "Log", "Program"):
        page.tab(tab)
        page.press("3")
        assert page.ask("() => document.documentElement.scrollWidth - innerWidth") <= 0, tab
    boxes = [page.page.locator(part).bounding_box() for part in (".floor", ".transport", ".timeline", ".panel")]
    assert all(box["width"] > 0.9 * width for box in boxes)
    assert [box["y"] for box in boxes] == sorted(box["y"] for box in boxes)


@pytest.mark.parametrize("width", [700, 1000, 1920])
def test_wide_screen_fits_without_scrolling(over, visit, width):
    page = visit(over.address, width=width, height=720)
    assert page.ask("() => document.documentElement.scrollWidth - innerWidth") <= 0
    assert page.ask("() => document.documentElement.scrollHeight - innerHeight") <= 0
    assert page.page.locator(".panel").bounding_box()["x"] > page.page.locator(".floor").bounding_box()["x"]


def test_dark_mode_follows_the_system_and_is_kept_once_chosen(over, visit):
    page = visit(over.address, color_scheme="dark")

    def ground():
        return page.ask(
            "() => { const c = document.querySelector('.floor canvas'); const d = new OffscreenCanvas(1, 1)"
            ".getContext('2d', {willReadFrequently: true}); d.drawImage(c, 2, c.height - 2, 1, 1, 0, 0, 1, 1);"
            "return [...d.getImageData(0, 0, 1, 1).data].slice(0, 3).reduce((a, b) => a + b) / 3; }"
        )

    until(lambda: ground() < 60, "a dark floor")
    page.button("Light colours").click()
    until(lambda: ground() > 200, "a light floor")
    page.page.reload()
    until(lambda: (page.read("frames") or 0) > 2, "the page draws")
    assert ground() > 200
    assert page.ask("() => document.documentElement.dataset.theme") == "light"


def test_page_asks_nobody_else_and_runs_under_a_strict_policy(over, visit):
    page = visit(over.address)
    page.tab("Radio")
    page.tab("Program")
    assert {url.split("/")[2] for url in page.requested if not url.startswith("data:")} == {f"127.0.0.1:{over.port}"}
    policy = page.ask("async () => (await fetch('/')).headers.get('content-security-policy')")
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    assert "-src" not in policy.replace("default-src", "")  # so nothing is inline, and everything from the server


def test_run_that_is_over_is_said_to_be(page):
    assert page.page.locator(".state").inner_text() == "finished after 21.6 s"


def test_logs_are_filtered_by_robot_level_and_text(page):
    page.seek(20.5)
    page.tab("Log")
    lines = page.page.locator(".loglines li")
    until(lambda: lines.count() > 5, "lines")
    filters = page.page.locator(".filters select")
    filters.nth(0).select_option("3")
    until(lambda: set(page.page.locator(".loglines .badge").all_inner_texts()) == {"3"}, "of robot 3 alone")
    few = lines.count()
    panel, field = (page.page.locator(each).bounding_box() for each in ("#panel", ".filters input"))
    assert field["x"] + field["width"] <= panel["x"] + panel["width"], "the field for text is within the panel"
    filters.nth(1).select_option("debug")
    until(lambda: lines.count() > few, "more with debug")
    page.page.get_by_placeholder("text").fill("enters")
    until(lambda: lines.count() == 1, "one line")
    lines.first.locator(".time").click()
    until(lambda: 10.0 < page.t < 13.0, "its instant")


def test_stepping_through_a_run_that_was_not_recorded_says_what_to_do(page):
    page.tab("Step")
    assert "Choose a robot" in page.page.locator("#panel").inner_text()
    page.press("3")
    trouble = page.page.locator(".step .trouble")
    until(lambda: trouble.count() and "start the run without --no-record" in trouble.inner_text(), "a sentence")
    assert page.button("Next firing").is_disabled()
    page.troubles.clear()  # the browser logs every answer of an error
