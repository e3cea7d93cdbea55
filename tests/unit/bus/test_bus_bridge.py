"""The inbox between zenoh's threads and the event loop."""

import asyncio
import threading

from rmr.bus import bridge
from rmr.bus.bridge import BATCH_MAX, INBOX_MAX, Inbox


def run(coroutine):
    return asyncio.run(coroutine)


def test_items_of_another_thread_arrive_on_the_loop_in_order():
    async def scene():
        inbox, taken, threads = Inbox(asyncio.get_running_loop()), [], set()

        def take(item, arrived):
            taken.append((item, arrived))
            threads.add(threading.get_ident())

        sender = threading.Thread(target=lambda: [inbox.put(take, item) for item in range(1000)])
        sender.start()
        while len(taken) < 1000:
            await asyncio.sleep(0)
        sender.join()
        assert [item for item, _ in taken] == list(range(1000))
        assert threads == {threading.get_ident()}
        assert [at for _, at in taken] == sorted(at for _, at in taken)

    run(scene())


def test_a_burst_wakes_the_loop_once():
    async def scene():
        loop = asyncio.get_running_loop()
        woken, wake = [], loop.call_soon_threadsafe
        loop.call_soon_threadsafe = lambda *args: woken.append(1) or wake(*args)
        inbox, taken = Inbox(loop), []
        for item in range(50):
            inbox.put(lambda item, _: taken.append(item), item)
        await asyncio.sleep(0)
        assert (len(woken), len(taken)) == (1, 50)

    run(scene())


def test_other_work_has_its_turn_between_two_batches():
    async def scene():
        inbox, taken = Inbox(asyncio.get_running_loop()), []
        for item in range(3 * BATCH_MAX):
            inbox.put(lambda item, _: taken.append(item), item)
        seen = []
        while len(taken) < 3 * BATCH_MAX:
            await asyncio.sleep(0)
            seen.append(len(taken))
        assert seen == [BATCH_MAX, 2 * BATCH_MAX, 3 * BATCH_MAX]

    run(scene())


def test_a_full_inbox_keeps_the_newest_and_counts_the_rest():
    async def scene():
        inbox, taken = Inbox(asyncio.get_running_loop()), []
        for item in range(INBOX_MAX + 7):
            inbox.put(lambda item, _: taken.append(item), item)
        while len(taken) < INBOX_MAX:
            await asyncio.sleep(0)
        assert inbox.overflowed == 7
        assert taken[0] == 7

    run(scene())


def test_an_item_that_arrives_while_draining_is_not_forgotten():
    async def scene():
        inbox, taken = Inbox(asyncio.get_running_loop()), []

        def take(item, _):
            taken.append(item)
            if item < 5:
                inbox.put(take, item + 1)

        inbox.put(take, 0)
        while len(taken) < 6:
            await asyncio.sleep(0)
        assert taken == list(range(6))

    run(scene())


def test_what_comes_after_the_loop_has_closed_is_dropped_in_silence():
    loop = asyncio.new_event_loop()
    inbox = Inbox(loop)
    loop.close()
    inbox.put(lambda item, at: None, 1)
    assert bridge.INBOX_MAX > bridge.BATCH_MAX
