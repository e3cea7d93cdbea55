"""The inbox between zenoh's threads and the event loop."""

import asyncio
import threading

from rmr.base.time import NS_PER_S
from rmr.bus import bridge
from rmr.bus.bridge import BATCH_MAX, INBOX_MAX, PATIENCE, Inbox, PreciseLoop, keep_thread


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


def test_item_after_loop_closed_is_dropped_without_error():
    loop = asyncio.new_event_loop()
    inbox = Inbox(loop)
    loop.close()
    inbox.put(lambda item, at: None, 1)
    assert bridge.INBOX_MAX > bridge.BATCH_MAX


# --- what may wait -----------------------------------------------------------------------------------------------


def on_precise_loop(scene):
    """Run `scene(loop, inbox, woken)`; `woken` lists the wake-ups from other threads."""

    async def play():
        loop, woken = asyncio.get_running_loop(), []
        wake = loop.call_soon_threadsafe
        loop.call_soon_threadsafe = lambda *args: woken.append(1) or wake(*args)
        await scene(loop, Inbox(loop), woken)

    with asyncio.Runner(loop_factory=PreciseLoop) as runner:
        runner.run(play())


def put_in_sleep(loop, inbox, take, items, patience):
    """Return a thread that puts `items` into the inbox as soon as the loop sleeps."""

    def put():
        while not loop.sleep.until:
            pass
        for item in items:
            inbox.put(take, item, patience)

    thread = threading.Thread(target=put)
    thread.start()
    return thread


def test_patient_item_is_handled_with_the_next_timer_before_its_callback():
    async def scene(loop, inbox, woken):
        taken, rung = [], asyncio.Event()
        loop.call_later(0.5, lambda: taken.append("timer") or rung.set())
        sender = put_in_sleep(loop, inbox, lambda item, _: taken.append(item), [1, 2], NS_PER_S)
        await rung.wait()
        sender.join()
        assert (taken, woken) == ([1, 2, "timer"], [])

    on_precise_loop(scene)


def test_urgent_item_wakes_the_loop_and_patient_item_does_so_without_a_timely_timer():
    async def scene(loop, inbox, woken):
        for patience in (0, PATIENCE):
            taken = asyncio.Event()
            woken.clear()
            sender = put_in_sleep(loop, inbox, lambda item, _, taken=taken: taken.set(), [1], patience)
            await taken.wait()
            sender.join()
            assert woken == [1]
            inbox.poll()  # nothing more came: the loop may sleep for long again

    on_precise_loop(scene)


def test_loop_sleeps_at_most_patience_after_activity():
    async def scene(loop, inbox, woken):
        taken = []
        for item in range(5):
            inbox.lively = True
            sender = put_in_sleep(loop, inbox, lambda item, _: taken.append(item), [item], PATIENCE)
            while len(taken) <= item:
                await asyncio.sleep(PATIENCE / NS_PER_S / 2)
            sender.join()
        assert (taken, woken) == ([0, 1, 2, 3, 4], [])

    on_precise_loop(scene)


def test_a_thread_may_be_kept_again_and_again():
    threads = [threading.Thread(target=lambda: [keep_thread() for _ in range(3)]) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not any(thread.is_alive() for thread in threads)
