"""The page of a recording: why, radio, routes, estimates, logs."""

import re

import pytest
from shown_run import ShownRecording, until

from rmr_lab.lab_folders import write_lab


@pytest.fixture
def page(recorded, visit):
    driver = visit(recorded.address)
    driver.pause()
    driver.press("3")
    driver.seek(15.0)
    return driver


def explained(page, text):
    """Return the items of the explanation, once `text` is among them."""
    items = page.page.locator(".why .item, .why .reason")
    until(lambda: text in items.all_inner_texts(), f"{text} in the explanation")
    return items.all_inner_texts()


def test_fact_is_explained_by_a_click_as_a_tree_that_unfolds(page):
    page.page.locator(".fact", has_text="waiting(@3)").click()
    assert explained(page, "waiting(@3)") == ["waiting(@3)", "crossing(@3, 30.0)", "start(@3)", "!due(@3, 30.0)"]
    tree = page.page.get_by_role("tree")
    assert "given by the lab" in tree.inner_text()
    tree.get_by_role("button", name="Fold").first.click()
    assert page.page.locator(".why .item").all_inner_texts() == ["waiting(@3)"]
    tree.get_by_role("button", name="Unfold").first.click()
    until(lambda: page.page.locator(".why .item").count() == 4, "the whole tree")
    tree.get_by_role("button", name="corridor.rmr:19").click()
    chosen = page.page.locator(".line.chosen")
    until(lambda: chosen.count() == 1 and "crossing(R, _)" in chosen.inner_text(), "the rule in the program")


def test_same_click_closes_the_explanation_again(page):
    fact = page.page.locator(".fact", has_text="waiting(@3)")
    fact.click()
    explained(page, "waiting(@3)")
    fact.click()
    until(lambda: page.page.locator(".why").count() == 0, "no explanation")


def test_absent_fact_is_explained_too(page):
    page.page.get_by_label("A fact that it does not hold").fill("at(@3, exit)")
    page.button("why not?").click()
    text = until(
        lambda: page.page.locator(".why .tree").count() and page.page.locator(".why .tree").inner_text(), "why"
    )
    assert "at(@3, exit) does not hold at 15.000 s" in text
    assert "moveto(@3, exit)" in text


def test_question_that_is_none_is_answered_with_a_sentence(page):
    page.page.get_by_label("A fact that it does not hold").fill("at(@3,")
    page.button("why not?").click()
    trouble = page.page.locator(".why .trouble")
    until(lambda: trouble.count() and trouble.inner_text().endswith("."), "a sentence")
    page.troubles.clear()  # the browser logs every answer of an error


def test_facts_goals_actions_and_schedule_are_those_of_the_instant(page):
    panel = page.page.locator("#panel")
    until(lambda: "moveto(@3, exit)" in panel.inner_text(), "the action of that instant")
    assert re.search(r"\d(st|nd|rd|th) of 6 · made by robot \d, term 1", panel.inner_text())
    assert "estimate off by" in panel.inner_text()
    page.seek(5.0)
    until(lambda: "moveto(@3, exit)" not in panel.inner_text(), "it has not begun yet")


def test_routes_and_estimates_are_drawn(page):
    page.seek(5.0)
    route = until(lambda: page.ask("() => window.__rmr.routes[3]"), "its route")
    assert route[-1] == [0.5, 0.75]
    page.press("e")
    estimate = until(lambda: page.ask("() => window.__rmr.estimates[3]"), "its estimate")
    truth = page.robots()[3]
    assert 0 < ((estimate[0] - truth["x"]) ** 2 + (estimate[1] - truth["y"]) ** 2) ** 0.5 < 0.05


def test_radio_counts_frames_and_draws_both_charts(page, recorded):
    page.seek(21.4)
    page.tab("Radio")
    counters = page.page.locator("#panel table.grid").first.locator("tbody tr")
    until(lambda: counters.count() == 6 and "still loading" not in page.page.locator("#panel").inner_text(), "counters")
    sent = [int(text) for text in counters.locator("td:nth-child(2)").all_inner_texts()]
    assert all(count > 50 for count in sent)
    assert page.page.locator(".uplot canvas").count() == 2
    frames = page.page.locator("#panel table.grid").last.locator("tbody tr")
    assert frames.count() > 5
    page.seek(1.0)
    until(lambda: int(counters.locator("td:nth-child(2)").first.inner_text()) < sent[0], "fewer at an earlier instant")


def test_frames_on_the_air_are_drawn_as_links(page):
    assert until(lambda: page.ask("() => window.__rmr.links"), "a frame")
    page.button("Frames").click()
    until(lambda: page.ask("() => window.__rmr.links") == 0, "none when they are switched off")


def test_missed_deadline_has_a_shape_and_words(recordings, visit):
    shown = ShownRecording(recordings("testbed/rush.yaml", "--seed", "1"))
    page = visit(shown.address)
    page.pause()
    page.press("End")
    missed = until(lambda: page.ask("() => window.__rmr.missed"), "missed deadlines")
    assert f"✕ {missed} missed" in page.page.locator(".tally").inner_text()
    assert page.page.locator(".bad", has_text="late").count() >= 1
    page.close()
    shown.close()


def test_click_on_a_missed_deadline_shows_the_owners_of_its_time(recordings, visit):
    shown = ShownRecording(recordings("testbed/rush.yaml", "--seed", "1"))
    page = visit(shown.address)
    page.pause()
    page.press("End")
    until(lambda: page.ask("() => window.__rmr.missed"), "missed deadlines")
    robot, place, job = page.ask(
        """() => {
            const { timeline, run } = window.__rmr.state;
            for (const [place, robot] of run.robots.entries()) {
                const lane = timeline.lanes.find((one) => one.robot === robot);
                const job = lane.deadlines.find((one) => one.met === false);
                if (job) return [robot, place, job];
            }
        }"""
    )
    begin, end = page.read("window")
    box = page.canvas("timeline").bounding_box()
    lane = (box["height"] - 30) / len(page.state("run")["robots"])
    x = 46 + (job["deadline_s"] - begin) / (end - begin) * (box["width"] - 56)
    page.canvas("timeline").click(position={"x": x, "y": 24 + (place + 0.5) * lane})
    panel = page.page.locator(".late")
    until(lambda: panel.locator("table.owners tbody tr").count() > 1, "owners of its time")
    assert page.state("selected") == robot
    times = panel.locator(".owners tbody td:nth-child(1)").all_inner_texts()
    seconds = [float(text.removesuffix(" s")) for text in times]
    assert seconds == sorted(seconds, reverse=True)
    whole = (job["finish_s"] or shown.source.clock.end_s) - job["begin_s"]
    assert abs(sum(seconds) - whole) < 0.05
    panel.locator("summary").click()
    assert panel.locator(".intervals li").count() >= len(seconds)
    panel.get_by_role("button", name="Close the explanation").click()
    until(lambda: panel.count() == 0, "no explanation")
    page.press("End")
    page.button("why late?").click()
    until(lambda: panel.locator("table.owners tbody tr").count() == len(seconds), "the same answer by the button")
    page.close()
    shown.close()


def test_a_mind_is_stepped_through_and_the_time_goes_along(page):
    page.tab("Step")
    stop = page.page.locator(".step .part", has_text="This stop")
    steps = page.page.locator(".step")

    def shows(*texts):
        until(lambda: stop.count() and all(text in stop.inner_text() for text in texts), f"{texts} at the stop")

    page.seek(0.05)
    shows("firing 2, rule corridor.rmr:19", "- crossing(@3, 30.0)", "+ action moveto(@3, exit)")
    page.button("Next firing").click()
    shows("firing 3, rule corridor.rmr:21")
    until(lambda: abs(page.t - 0.275) < 0.001, "its instant")
    assert "nothing: no other rule was satisfied" in steps.inner_text()
    page.press("k")
    shows("firing 2, rule corridor.rmr:19")
    until(lambda: page.t == 0.0, "its instant")
    page.press("k")
    shows("firing 1, rule corridor.rmr:15")
    assert "rule corridor.rmr:19: crossing(@3, 30.0)  <- fires next" in steps.inner_text()
    page.press("Shift+I")
    shows("given by the lab", "+ !due(@3, 30.0)")
    page.press("i", "i")  # one after the other, however fast
    shows("0.275 s  sensed", "+ turn(@3, crossing, 4)")


def test_step_goes_to_an_instant_a_fact_and_a_breakpoint(page):
    page.tab("Step")
    stop = page.page.locator(".step .part", has_text="This stop")
    field = page.page.get_by_label("An instant or a fact")

    def shows(text):
        until(lambda: stop.count() and text in stop.inner_text(), f"{text} at the stop")

    field.fill("21s")
    page.button("Go to it").click()
    shows("action moveto(@3, exit) completed")
    field.fill("crossing(@3, _)")
    page.button("Back to it").click()
    shows("+ crossing(@3, 30.0)")
    until(lambda: page.t == 0.0, "its instant")
    assert page.button("Next breakpoint").is_disabled()
    page.page.get_by_label("Breakpoint on corridor.rmr:21").check()
    page.press("c")
    shows("firing 3, rule corridor.rmr:21")
    page.button("Next breakpoint").click()
    nowhere = page.page.locator(".step .trouble")
    until(lambda: "no firing of a rule with a breakpoint after this stop" in nowhere.inner_text(), "nowhere to go")
    page.press("Shift+C")
    until(lambda: "before this stop" in nowhere.inner_text(), "nowhere back")
    stop.get_by_role("button", name="corridor.rmr:21").click()
    chosen = page.page.locator(".line.chosen")
    until(lambda: chosen.count() == 1 and "lineup(R, entry, K)" in chosen.inner_text(), "the rule in the program")


def test_step_tells_bad_input_as_the_terminal_does_and_stays(page):
    page.tab("Step")
    stop = page.page.locator(".step .part", has_text="This stop")
    until(stop.count, "the stop")
    before = stop.inner_text(), page.t
    field = page.page.get_by_label("An instant or a fact")
    trouble = page.page.locator(".step .trouble")
    for text, said in (
        ("12 parsecs", "'to 12 parsecs': write an instant of lab time as 12.3s, 500ms or 1.5min."),
        ("at(@4, exit)", "is a fact of robot 4, not of robot 3"),
    ):
        field.fill(text)
        field.press("Enter")
        until(lambda said=said: trouble.count() and said in trouble.inner_text(), said)
    assert (stop.inner_text(), page.t) == before
    page.troubles.clear()  # the browser logs every answer of an error


def test_page_opens_at_the_instant_and_robot_of_its_address(recorded, visit):
    page = visit(recorded.address + "#t=12.5&robot=4")
    assert page.t == 12.5
    assert page.state("selected") == 4


def test_drives_before_a_turn_stay_in_the_lane_and_words_are_those_of_the_lab(recordings, visit, tmp_path):
    write_lab(tmp_path / "shop")
    shown = ShownRecording(recordings(str(tmp_path / "shop")))
    page = visit(shown.address)
    page.pause()
    page.press("End")
    page.press("2")
    box = page.canvas("timeline").bounding_box()
    begin, end = page.read("window")
    lane = (box["height"] - 30) / 3

    def told(t):
        x = 46 + (t - begin) / (end - begin) * (box["width"] - 56)
        page.canvas("timeline").hover(position={"x": x, "y": 24 + 1.5 * lane})
        return page.page.locator(".timeline .tip").inner_text()

    assert "moveto(@2, shelf): 0.0 s to" in told(5.0)
    intervals = page.ask("() => window.__rmr.state.timeline.lanes[1].intervals")
    inside = told(intervals[-1]["begin_s"] + 0.5)
    assert "inside" in inside
    assert "moveto" not in inside, "the turn hides its last part, and its own actions"
    assert "pack(" not in inside
    asked = page.page.get_by_label("A fact that it does not hold")
    until(lambda: asked.get_attribute("placeholder") == "packed(@2)", "an example of this lab")
    page.close()
    shown.close()


def test_a_heading_is_never_360_degrees(recorded, visit):
    page = visit(recorded.address + "#robot=3")
    page.pause()
    until(lambda: "heading" in page.page.locator(".pose").inner_text(), "its pose")
    told = page.ask(
        """async () => {
            const module = await import("/static/robot.js");
            return [-0.001, 0, 6.2831, -6.2831, 3.1416, -1.5708].map(module.degreesOf);
        }"""
    )
    assert told == [0, 0, 0, 0, 180, 270]
