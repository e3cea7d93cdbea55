"""CSS animations of one length, from values at instants of lab time."""

import math
from collections.abc import Sequence

HOLD_S = 2.5
"""Time for which the end is shown before an animation begins anew, seconds."""


class Keyframes:
    """The animations of one picture; equal ones are written once."""

    def __init__(self, end_s: float, speed: float) -> None:
        """`speed` is lab time over time."""
        self._end_s = end_s
        self._speed = speed
        self._length_s = end_s / speed + HOLD_S
        self._names: dict[str, str] = {}

    def moving(self, stops: Sequence[tuple[float, str]], step_ends: Sequence[int] = ()) -> str:
        """Return the classes of an element that has each declaration at its instant, and changes evenly between.

        `step_ends` are the numbers of jumps from each stop to the next one in place of an even change.
        """
        texts: dict[str, list[str]] = {}
        for place, (at, declaration) in enumerate(stops):
            steps = f";animation-timing-function:steps({step_ends[place]})" if _jumps(step_ends, place) else ""
            percents = texts.setdefault(declaration + steps, [])
            percents += [*(["0%"] if not place and at > 0.0 else []), self._percent(at)]
        texts.setdefault(stops[-1][1], []).append("100%")
        return self._named("".join(f"{','.join(dict.fromkeys(p))}{{{d}}}" for d, p in texts.items()))

    def shown(self, spans: Sequence[tuple[float, float]]) -> str:
        """Return the attributes of an element that is visible in these spans of lab time; inf: no end."""
        last = any(end == math.inf for _, end in spans)
        rest = "" if last else 'opacity="0" '
        percents = [(self._percent(begin), self._percent(end) if end < math.inf else "") for begin, end in spans]
        percents = [(begin, end) for begin, end in percents if begin != end]  # too short to be seen
        visible = [begin for begin, _ in percents]
        hidden = [end for _, end in percents if end and end not in visible]
        if "0%" not in visible:
            hidden.insert(0, "0%")
        (visible if last else hidden).append("100%")
        step = ";animation-timing-function:step-end"
        body = "".join(
            f"{','.join(places)}{{opacity:{opacity}{step}}}"
            for opacity, places in ((1, visible), (0, hidden))
            if places
        )
        return f'{rest}class="{self._named(body)}"'

    def style(self) -> str:
        """Return the style sheet of all animations that were asked for."""
        head = f".a {{ animation: {self._length_s:.2f}s linear infinite }}\n"
        return head + "".join(
            f".{name}{{animation-name:{name}}}@keyframes {name}{{{body}}}\n" for body, name in self._names.items()
        )

    def _named(self, body: str) -> str:
        return f"a {self._names.setdefault(body, f'k{len(self._names)}')}"

    def _percent(self, at: float) -> str:
        share = 100.0 * min(max(at, 0.0), self._end_s) / self._speed / self._length_s
        return f"{share:.2f}".rstrip("0").rstrip(".") + "%"


def _jumps(step_ends: Sequence[int], place: int) -> bool:
    return place < len(step_ends) and step_ends[place] > 0
