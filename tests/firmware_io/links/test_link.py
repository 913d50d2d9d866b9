# SPDX-License-Identifier: MIT
from segway_ecc.firmware_io.links.link import LinkCounters, Meter

S = 1_000_000_000


class Clock:
    def __init__(self) -> None:
        self.now_ns = 7 * S

    def __call__(self) -> int:
        return self.now_ns


def test_rates_are_those_between_two_looks() -> None:
    counters, clock = LinkCounters(sent=1000, received=1000, error_frames=1000, bits=1_000_000), Clock()
    meter = Meter(counters, clock)

    clock.now_ns += 2 * S
    counters.sent, counters.received, counters.error_frames, counters.bits = 1200, 1400, 1003, 1_500_000
    assert meter.measure(500_000) == {
        "sent_per_s": "100.0",
        "received_per_s": "200.0",
        "errors_per_s": "1.5",
        "load_percent": "50.0",
    }

    clock.now_ns += S // 2
    counters.sent += 5
    assert meter.measure(1_000_000) == {
        "sent_per_s": "10.0",
        "received_per_s": "0.0",
        "errors_per_s": "0.0",
        "load_percent": "0.0",
    }


def test_two_measurements_at_one_time_are_equal() -> None:
    counters, clock = LinkCounters(), Clock()
    meter = Meter(counters, clock)
    assert set(meter.measure(1).values()) == {"0.0"}

    clock.now_ns += S
    counters.sent = 4
    first = meter.measure(500_000)
    counters.sent = 8
    assert meter.measure(500_000) == first
    clock.now_ns += S
    assert meter.measure(500_000)["sent_per_s"] == "4.0", "nothing was forgotten over it"
