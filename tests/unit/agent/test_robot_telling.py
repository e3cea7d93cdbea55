"""How a robot tells its part of the report, small and large, with a bus that keeps what it is given."""

import asyncio

from rmr.bus import wire
from rmr.bus.message_parts import TooLargeError
from rmr_agent.robot_telling import StatusPublisher

STATUS = wire.Status("running", "", False, False, 0, {})


class StubBus:
    """Takes messages of so many octets."""

    def __init__(self, octets_max=wire.WHOLE_OCTETS_MAX):
        self.published, self.octets_max = [], octets_max

    def publish(self, key, body):
        self.published.append(body)

    async def publish_whole(self, key, body):
        octets = len(wire.encode(1, 1, 1, body))
        if octets > self.octets_max:
            raise TooLargeError(octets)
        self.published.append(body)
        return octets


def told(bus, *statuses, report):
    warnings = []

    async def tell():
        telling = StatusPublisher(bus, warnings.append)
        for status in statuses:
            await telling.tell("k", status, lambda: dict(report))

    asyncio.run(tell())
    return [body.report for body in bus.published], warnings


def test_small_report_is_sent_with_each_status_and_large_report_rarely_and_at_the_end():
    final = STATUS._replace(final=True)
    large = {"facts": ["x" * 1000] * 5000}
    reports, _ = told(StubBus(), STATUS, STATUS, final, report=large)
    assert [bool(report) for report in reports] == [True, False, True]


def test_lists_that_do_not_fit_are_left_out_and_named():
    report = {"actions": [[0.0, "x" * 900]], "facts": ["y" * 900], "undelivered": 2}
    reports, warnings = told(StubBus(octets_max=500), STATUS, report=report)
    assert reports == [{"actions": [], "facts": [], "undelivered": 2, "left_out": ["actions", "facts"]}]
    assert warnings[-1].endswith("left out of it: actions, facts")
