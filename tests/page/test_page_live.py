"""The page of a run that goes on: live, steering, faults, a server that goes and returns."""

from itertools import pairwise

from shown_run import FASTEST, until


def test_live_page_follows_the_run_shortly_behind_it(shown, visit):
    run = shown("corridor")
    page = visit(run.address)
    assert page.read("live")
    begin = page.t
    until(lambda: page.t > begin + 1.5, "lab time goes on")
    assert page.t <= run.source.clock.t
    assert "running" in page.page.locator(".state").inner_text()


def test_slider_goes_back_while_the_run_goes_on_and_live_returns(shown, visit):
    run = shown("corridor", speed=4.0)
    page = visit(run.address)
    until(lambda: page.read("end") > 4.0, "some history")
    page.seek(1.0)
    assert not page.read("live")
    page.pause()
    until(lambda: not page.read("playing"), "the page stands")
    standing = page.t
    end = page.read("end")
    until(lambda: page.read("end") > end + 1.0, "the run goes on")
    assert page.t == standing
    page.button("Live").click()
    until(lambda: page.read("live") and page.t > end, "it follows the run again")


def test_simulated_run_is_paused_stepped_and_sped_up(shown, visit):
    run = shown("corridor")
    page = visit(run.address)
    steering = page.page.get_by_role("group", name="Simulation")
    steering.get_by_role("button", name="Pause").click()
    until(lambda: not run.pacer.running, "paused")
    until(lambda: "paused" in page.page.locator(".state").inner_text(), "the page says so")
    until(lambda: abs(page.t - run.source.clock.t) < 0.02, "the page shows the newest instant")
    for _ in range(2):  # the newest instant told before the pause may be some ticks old
        at = run.source.clock.t
        steering.get_by_role("button", name="Step").click()
        until(lambda at=at: run.source.clock.t > at, "a tick")
    assert run.source.clock.t - at < 0.02
    until(lambda: abs(page.t - run.source.clock.t) < 0.002, "the page shows the tick")
    steering.get_by_role("button", name="Resume").click()
    until(lambda: run.pacer.running, "resumed")
    steering.get_by_role("combobox", name="Speed").select_option("5")
    until(lambda: run.pacer.speed == 5.0, "five times as fast")


def test_partition_and_loss_are_shown_as_active_and_cleared(shown, visit):
    run = shown("corridor", control=True)
    page = visit(run.address)
    page.tab("Faults")
    for robot in (1, 2, 3):
        page.button(f"robot {robot} on the other side").click()
    page.page.get_by_label("Lasts").fill("60")
    page.button("Partition 1, 2, 3 | 4, 5, 6").click()
    line = page.page.locator(".faultline")
    until(lambda: line.count() and "partition 1, 2, 3 | 4, 5, 6" in line.inner_text(), "the partition is shown")
    page.page.locator("input[aria-label^='Share']").fill("30")
    page.button("Lose 30 % of all frames").click()
    until(lambda: "loss 30 %" in line.inner_text(), "the loss is shown")
    assert len(run.simulation.fault_records) == 2
    page.button("Clear radio faults").click()
    until(lambda: line.count() == 0, "nothing is active any more")
    assert "No fault is active" in page.page.locator(".faultpanel").inner_text()


def test_robot_is_killed_and_restarted_by_button(shown, visit):
    run = shown("corridor", control=True)
    page = visit(run.address)
    page.press("5")
    page.tab("Faults")
    page.button("Kill").click()
    until(lambda: run.simulation.is_dead(5), "robot 5 is dead")
    until(lambda: "robot 5 killed" in page.page.locator(".faultpanel .active").inner_text(), "the page says so")
    page.button("Restart").click()
    until(lambda: not run.simulation.is_dead(5), "robot 5 lives")
    until(lambda: "robot 5 killed" not in page.page.locator(".faultpanel .active").inner_text(), "the page says so")


def test_order_that_is_refused_is_answered_with_a_sentence(shown, visit):
    run = shown("corridor", control=True)
    page = visit(run.address)
    page.press("5")
    page.tab("Faults")
    page.button("Restart").click()  # it lives
    alert = page.page.get_by_role("alert")
    until(alert.count, "an answer")
    assert alert.inner_text().split("\n")[0].endswith(".")
    page.button("Dismiss").click()
    assert alert.count() == 0
    page.troubles.clear()  # the browser logs every answer of an error


def test_page_without_the_token_offers_no_faults_and_says_why(shown, visit):
    run = shown("corridor", control=True)
    page = visit(run.address.split("#")[0])
    page.tab("Faults")
    assert "lacks the token" in page.page.locator("#panel").inner_text()
    assert page.button("Kill").count() == 0
    assert page.page.get_by_role("group", name="Simulation").count() == 0


def test_page_without_control_has_no_tab_of_faults(over, visit):
    page = visit(over.address)
    assert page.page.get_by_role("tab", name="Faults").count() == 0


def test_page_reconnects_when_the_server_returns(shown, visit):
    run = shown("corridor", speed=0.5)
    page = visit(run.address)
    until(lambda: page.t > 0.5, "it runs")
    run.server.stop()
    notices = page.page.locator(".notices")
    until(lambda: "connection to the server is lost" in notices.inner_text(), "the page says so")
    drawn = page.read("frames")
    until(lambda: page.read("frames") > drawn + 3, "it still draws")
    run.restart_server()
    until(lambda: page.state("connection")["state"] == "open", "connected again")
    until(lambda: "lost" not in notices.inner_text(), "no more word of it")
    at = run.source.clock.t
    until(lambda: page.t > at, "it follows the run again")
    page.troubles.clear()  # the browser logs refused connections


def tries(page, count):
    """Return the first `count` waiting times before a new connection, in ms; None while there are fewer."""
    waits = page.ask("() => window.waits")
    return waits[:count] if len(waits) >= count else None


def test_waiting_time_between_tries_grows(shown, visit):
    run = shown("corridor", speed=0.5)
    page = visit(run.address)
    page.ask(
        "() => { window.waits = []; const old = window.setTimeout; "
        "window.setTimeout = (act, ms, ...rest) => "
        "{ if (String(act).includes('connect')) window.waits.push(ms); return old(act, Math.min(ms, 20), ...rest); }; }"
    )
    run.server.stop()
    waits = until(lambda: tries(page, 5), "five tries")
    assert all(later > 1.2 * earlier for earlier, later in pairwise(waits))
    assert max(waits) <= 12_000
    run.restart_server()
    until(lambda: page.state("connection")["state"] == "open", "connected again")
    page.troubles.clear()


def test_end_of_a_live_run_is_said(shown, visit):
    run = shown("corridor")
    page = visit(run.address)
    until(lambda: page.page.locator(".state").inner_text() == "running", "the page follows the run")
    run.pacer.stop()  # to the end at once
    said = "The run is over: all robots finished after 21.6 s. 6 of 6 deadlines were met."
    until(lambda: said in page.page.locator(".notices").inner_text(), "the end")
    assert page.page.locator(".state").inner_text() == "finished after 21.6 s"
    until(lambda: len(page.robots()) == 6, "all robots are still drawn")


def test_clock_hides_jitter_of_arrival(over, visit):
    page = visit(over.address)
    shown_at = page.ask(
        """async () => {
          const { PlaybackClock, BUFFER_S } = await import("/static/clock.js");
          const clock = new PlaybackClock();
          clock.running = true;
          clock.goLive();
          let seed = 7;
          const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
          const arrivals = [];
          for (let t = 0; t < 12; t += 0.1) arrivals.push([t + 0.02 + 0.17 * random(), t]);
          arrivals.sort((a, b) => a[0] - b[0]);
          const seen = [];
          for (let wall = 0; wall < 12; wall += 1 / 60) {
            while (arrivals.length && arrivals[0][0] <= wall) clock.sample(arrivals.shift()[1], wall);
            seen.push([wall, clock.frame(wall)]);
          }
          return seen;
        }"""
    )
    late = [(wall, t) for wall, t in shown_at if wall > 3]
    steps = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(late)]
    assert min(steps) > 0.8, "it never stands"
    assert max(steps) < 1.2, "it never jumps"
    assert all(0.2 < wall - t < 0.6 for wall, t in late)


def test_source_of_a_program_is_text_and_never_markup(shown, visit):
    run = shown("corridor", speed=FASTEST)
    run.source._program = {
        "name": "<b>x.rmr",
        "source": "// <img src=x onerror='window.hacked=1'> <script>1</script>\n",
    }
    page = visit(run.address)
    page.tab("Program")
    assert "<img src=x onerror='window.hacked=1'>" in page.page.locator(".program pre").inner_text()
    assert page.ask("() => window.hacked") is None


def test_fifty_robots_are_drawn_at_a_usable_rate(shown, visit):
    run = shown("hall", speed=2.0)
    page = visit(run.address)
    until(lambda: len(page.robots()) == 50, "fifty robots")
    counted = page.ask(
        """async () => {
          const [begin, wall] = [window.__rmr.frames, performance.now()];
          await new Promise((resolve) => setTimeout(resolve, 3000));
          return ((window.__rmr.frames - begin) * 1000) / (performance.now() - wall);
        }"""
    )
    assert counted > 3  # a loaded machine without a graphics processor; an idle one draws more than 30


def test_who_looks_at_the_faults_when_the_run_ends_is_shown_the_chosen_robot(shown, visit):
    run = shown("corridor", control=True)
    page = visit(run.address)
    page.tab("Faults")
    page.press("5")
    until(page.button("Kill").count, "robot 5 is chosen")
    run.simulation.stop()
    until(lambda: page.page.get_by_role("tab", name="Faults").count() == 0, "faults cannot be added any more")
    panel = page.page.locator("#panel")
    until(lambda: "!due(@5, 34.0)" in panel.inner_text(), "what robot 5 knows")


def test_a_drive_under_way_reaches_to_the_present_while_nothing_new_is_recorded(shown, visit):
    run = shown("testbed", control=True)
    page = visit(run.address)
    drive = """() => window.__rmr.state.timeline?.lanes.flatMap((lane) => lane.actions).find((one) => one.open)"""
    under_way = until(lambda: page.ask(drive), "an action is under way")
    assert under_way["end_s"] >= under_way["begin_s"]
