"""Several senders over one session: what each hears, and what becomes of the others when one leaves."""

from bus_star import FRAME, on_a_star, until

KEY = "rmr/x/radio/0/0"


def test_seats_of_one_session_receive_each_other_but_not_themselves():
    async def scene(_router, one, stranger):
        heard = {1: [], 7: [], "stranger": []}
        seat = one.seat(7)
        one.subscribe(KEY, lambda _, message: heard[1].append(message.sender))
        seat.subscribe(KEY, lambda _, message: heard[7].append(message.sender))
        stranger.subscribe(KEY, lambda _, message: heard["stranger"].append(message.sender))

        def everybody():
            for bus in (one, seat, stranger):
                bus.publish(KEY, FRAME)
            return all(len(set(senders)) == 2 for senders in heard.values())

        await until(everybody)
        assert {who: set(senders) for who, senders in heard.items()} == {1: {7, 2}, 7: {1, 2}, "stranger": {1, 7}}
        assert [bus.losses.lost + bus.losses.repeated for bus in (one, seat, stranger)] == [0, 0, 0]
        seat.close()

    on_a_star(scene)


def test_closing_a_seat_keeps_the_session_and_the_other_subscriptions():
    async def scene(router, one):
        seat, heard, left, alive = one.seat(7), [], [], {}
        router.watch_alive("rmr/x/alive/robot/*", lambda key, there: alive.update({key[-1]: there}))
        for bus, robot in ((one, 1), (seat, 7)):
            bus.declare_alive(f"rmr/x/alive/robot/{robot}")
        seat.subscribe(KEY, lambda _, message: left.append(message.number))
        one.subscribe(KEY, lambda _, message: heard.append(message.number))
        await until(lambda: router.publish(KEY, FRAME) or (heard and alive == {"1": True, "7": True}))
        seat.close()
        await until(lambda: alive == {"1": True, "7": False})
        left.clear()
        before = len(heard)
        await until(lambda: router.publish(KEY, FRAME) or len(heard) > before + 3)
        assert left == []
        seat.publish(KEY, FRAME)  # of one who has left, nothing more
        assert one.connected

    on_a_star(scene, clients=1)


def test_loss_is_counted_once_for_several_subscribers_and_unsubscribed_receives_nothing():
    async def scene(router, one):
        seat, first, second = one.seat(7), [], []
        withdraw = one.subscribe(KEY, lambda _, message: first.append(message.number))
        seat.subscribe(KEY, lambda _, message: second.append(message.number))
        await until(lambda: router.publish(KEY, FRAME) or (first and second))
        router._numbers[KEY] += 5  # as if the bus had dropped five
        seen = router._numbers[KEY]
        await until(lambda: router.publish(KEY, FRAME) or first[-1] > seen)
        assert one.losses.lost + seat.losses.lost == 5
        withdraw()
        first.clear()
        second.clear()
        await until(lambda: router.publish(KEY, FRAME) or second)
        assert first == []
        seat.close()

    on_a_star(scene, clients=1)
