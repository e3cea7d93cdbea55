"""Chromium at the page: what a test does there and reads from it.

The page tells what it has drawn last in `window.__rmr`. Scripts are not evaluated in the page itself, which its content
security policy forbids, but over the browser's own protocol.
"""

from typing import Any

from playwright.sync_api import Browser, Locator
from shown_run import until


class PageDriver:
    """One tab. Every message of the console that is an error or a warning is kept in `troubles`."""

    def __init__(self, browser: Browser, address: str, *, width: int = 1280, height: int = 800, **context: Any) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": height}, **context)
        self.page = self.context.new_page()
        self.troubles: list[str] = []
        self.requested: set[str] = set()
        self.page.on("console", lambda said: said.type in {"error", "warning"} and self.troubles.append(said.text))
        self.page.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.page.on("request", lambda request: self.requested.add(request.url))
        self.page.goto(address)
        until(lambda: (self.read("frames") or 0) > 2, "the page draws")

    def read(self, name: str) -> Any:
        """Return an attribute of `window.__rmr`; None before the page is there."""
        return self.page.evaluate("name => window.__rmr && window.__rmr[name]", name)

    def ask(self, script: str, given: Any = None) -> Any:
        """Return the value of a function in the page."""
        return self.page.evaluate(script, given)

    def state(self, name: str) -> Any:
        """Return a part of the page's state."""
        return self.page.evaluate("name => window.__rmr.state[name]", name)

    @property
    def t(self) -> float:
        """The instant that is shown."""
        return float(self.read("t"))

    def robots(self) -> dict[int, dict[str, float]]:
        """Return the poses that were drawn last."""
        return {int(robot): pose for robot, pose in self.read("robots").items()}

    def press(self, *keys: str) -> None:
        """Press keys one after the other."""
        for key in keys:
            self.page.keyboard.press(key)

    def pause(self) -> None:
        """Let the page stand where it is."""
        if self.read("playing") or self.read("live"):
            self.press(" ")

    def seek(self, t: float) -> None:
        """Move the slider to `t`, as a hand does."""
        self.page.locator(".slider").evaluate(
            "(slider, t) => { slider.value = t; slider.dispatchEvent(new Event('input', {bubbles: true})); }", t
        )
        until(lambda: abs(self.t - t) < 0.02 or self.read("playing"), f"the page shows {t} s")

    def tab(self, name: str) -> None:
        """Open a tab of the panel."""
        self.page.get_by_role("tab", name=name).click()

    def button(self, name: str, *, exact: bool = True) -> Locator:
        """Return the button called `name`."""
        return self.page.get_by_role("button", name=name, exact=exact)

    def canvas(self, which: str) -> Locator:
        """Return the canvas of the floor or of the timeline."""
        return self.page.locator(f".{which} canvas")

    def click_robot(self, robot: int) -> None:
        """Click where a robot is drawn."""
        x, y = self.ask("robot => window.__rmr.place(robot)", robot)
        self.canvas("floor").click(position={"x": x, "y": y})

    def close(self) -> None:
        """Close the tab; fail if the console had errors."""
        self.context.close()
