# SPDX-License-Identifier: MIT
"""A simulated network: when what is sent arrives, in which order, and what never does."""

import pytest

from segway_ecc.hil.placement.network import Channel, Delivery, Network, Partition

MS = 1_000_000
S = 1_000_000_000


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.ns = 0

    def now_ns(self) -> int:
        return self.ns


def channel(network: Network, delivery: Delivery = Delivery.ANY_ORDER, seed: str = "a") -> tuple[Channel[int], Clock]:
    clock = Clock()
    return Channel(network, delivery, seed, clock.now_ns), clock


def arrivals(network: Network, delivery: Delivery, count: int = 400, seed: str = "a") -> list[tuple[int, int, int]]:
    """What arrives of messages that are sent one a millisecond: number, sent, arrived, ns."""
    way, clock = channel(network, delivery, seed)
    for number in range(count):
        clock.ns = number * MS
        way.send(number)
    clock.ns = 3600 * S
    return [(found.item, found.sent_ns, found.arrived_ns) for found in way.receive()]


def test_nothing_between_is_no_time() -> None:
    way, _ = channel(Network())
    way.send(7)
    assert [found.item for found in way.receive()] == [7]
    assert way.receive() == []


def test_a_message_arrives_after_the_latency_and_not_before() -> None:
    way, clock = channel(Network(latency_s=0.05))
    clock.ns = 3 * MS
    way.send(7)
    assert way.next_ns == 53 * MS
    clock.ns = 53 * MS - 1
    assert way.receive() == []
    clock.ns += 1
    assert way.receive() == [(7, 3 * MS, 53 * MS)]
    assert way.next_ns is None


def test_what_was_sent_before_now_counts_from_then() -> None:
    way, clock = channel(Network(latency_s=0.01))
    clock.ns = 20 * MS
    way.send(1, 5 * MS)
    assert way.receive() == [(1, 5 * MS, 15 * MS)]


@pytest.mark.parametrize("delivery", Delivery)
def test_jitter_spreads_both_ways_and_no_further(delivery: Delivery) -> None:
    took = [arrived - sent for _, sent, arrived in arrivals(Network(latency_s=0.02, jitter_s=0.01), delivery)]
    assert min(took) >= 10 * MS
    assert max(took) <= 30 * MS
    if delivery is Delivery.ANY_ORDER:
        assert max(took) - min(took) > 19 * MS


def test_in_any_order_one_overtakes_another_and_nothing_is_dropped() -> None:
    numbers = [number for number, _, _ in arrivals(Network(latency_s=0.02, jitter_s=0.01), Delivery.ANY_ORDER)]
    assert numbers != sorted(numbers)
    assert sorted(numbers) == list(range(400))


def test_of_the_newest_what_was_overtaken_is_dropped() -> None:
    numbers = [number for number, _, _ in arrivals(Network(latency_s=0.02, jitter_s=0.01), Delivery.NEWEST)]
    assert numbers == sorted(numbers)
    assert 50 < len(numbers) < 400


def test_in_order_nothing_overtakes_and_nothing_is_lost() -> None:
    found = arrivals(Network(latency_s=0.02, jitter_s=0.01, loss=0.3), Delivery.IN_ORDER)
    assert [number for number, _, _ in found] == list(range(400))
    times = [arrived for _, _, arrived in found]
    assert times == sorted(times)


def test_what_is_lost_in_order_comes_a_round_trip_later() -> None:
    """A way of 20 ms: the second attempt is sent 40 ms and the answers' 10 ms after the first."""
    first = arrivals(Network(latency_s=0.02, loss=0.5), Delivery.IN_ORDER, count=1, seed="c")
    took = {arrivals(Network(latency_s=0.02, loss=0.5), Delivery.IN_ORDER, 1, str(i))[0][2] for i in range(40)}
    assert {20 * MS, 70 * MS, 120 * MS} <= took
    assert all((ns - 20 * MS) % (50 * MS) == 0 for ns in took | {first[0][2]})


def test_what_is_lost_in_order_may_be_repeated_later_than_that() -> None:
    network = Network(latency_s=0.02, loss=0.5, repeats_s=3.0)
    took = {arrivals(network, Delivery.IN_ORDER, 1, str(i))[0][2] for i in range(40)}
    assert {20 * MS, 3020 * MS} <= took
    assert all((ns - 20 * MS) % (3000 * MS) == 0 for ns in took)


@pytest.mark.parametrize("loss", [0.05, 0.5])
def test_as_much_is_lost_as_declared(loss: float) -> None:
    arrived = len(arrivals(Network(loss=loss), Delivery.ANY_ORDER, count=10_000))
    assert arrived == pytest.approx(10_000 * (1.0 - loss), abs=200)


def test_lost_messages_are_counted() -> None:
    way, clock = channel(Network(latency_s=0.02, jitter_s=0.01, loss=0.2), Delivery.NEWEST)
    for number in range(200):
        clock.ns = number * MS
        way.send(number)
    clock.ns = S
    arrived = len(way.receive())
    assert way.sent == 200
    assert way.lost == 200 - arrived > 0


def test_in_a_partition_nothing_passes_that_is_sent_or_would_arrive_in_it() -> None:
    network = Network(latency_s=0.01, partitions=(Partition(0.1, 0.05),))
    passed = {number for number, _, _ in arrivals(network, Delivery.ANY_ORDER, count=200)}
    assert set(range(200)) - passed == set(range(90, 150))


def test_in_order_what_was_sent_in_a_partition_comes_after_it() -> None:
    network = Network(latency_s=0.01, partitions=(Partition(0.1, 0.05),))
    found = arrivals(network, Delivery.IN_ORDER, count=200)
    assert [number for number, _, _ in found] == list(range(200))
    assert all(not 100 * MS <= arrived < 150 * MS for _, _, arrived in found)


def test_equal_seeds_agree_and_others_do_not() -> None:
    network = Network(latency_s=0.02, jitter_s=0.01, loss=0.2)
    runs = [arrivals(network, Delivery.ANY_ORDER, seed=seed) for seed in ("a", "a", "b")]
    assert runs[0] == runs[1] != runs[2]


def test_a_network_that_grows_does_so_in_its_time() -> None:
    network = Network(latency_s=0.04, begins_s=2.0, grows_s=4.0)
    assert [network.share(time_s) for time_s in (0.0, 1.999, 2.0, 3.0, 6.0, 60.0)] == [0.0, 0.0, 0.0, 0.25, 1.0, 1.0]
    way, clock = channel(network)
    clock.ns = 4 * S
    way.send(1)
    assert way.next_ns == 4 * S + 20 * MS


def test_one_that_does_not_grow_is_there_at_once() -> None:
    assert [Network(begins_s=1.0).share(time_s) for time_s in (0.999, 1.0)] == [0.0, 1.0]
