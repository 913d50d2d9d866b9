# SPDX-License-Identifier: MIT
"""How the loop ends, and what it leaves behind; the rest is in test_loop.py."""

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.testing import Bench

WAY_OUT = ["disarm", "final", "close", "stage closed", "recorder closed"]
AFTER_OPENING = ["close", "stage closed", "recorder closed"]


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    """A bench whose robot drives from its second cycle on."""
    bench = make_bench()
    for cycle in range(1, 20):
        bench.stage.send_setpoint(cycle, Setpoint(2.0, 0.0))
    return bench


def way_out(bench: Bench) -> list[str]:
    """What was called after the last cycle's exchange, stage and equations."""
    last = max(index for index, entry in enumerate(bench.journal) if entry in ("publish", "equations", "open"))
    return bench.journal[last + 1 :]


def test_a_number_of_cycles(bench: Bench) -> None:
    bench.loop.run(cycles=5)
    assert len(bench.recorder.records) == bench.loop.counters.cycles == 5
    assert bench.loop.stop_reason == "5 cycles were asked for"
    assert way_out(bench) == WAY_OUT


def test_a_request_to_stop_ends_it_after_the_present_cycle_and_the_first_reason_counts(bench: Bench) -> None:
    def ask() -> None:
        bench.loop.stop("SIGINT")
        bench.loop.stop("SIGTERM")

    bench.clock.events[3] = ask
    bench.loop.run()
    assert len(bench.recorder.records) == 4
    assert bench.loop.stop_reason == "SIGINT"
    assert way_out(bench) == WAY_OUT


def test_a_world_that_is_over_ends_it_after_that_cycle(bench: Bench) -> None:
    bench.stage.over_after = (3, "the sequence is over")
    bench.loop.run()
    assert len(bench.recorder.records) == 4
    assert bench.loop.stop_reason == "the sequence is over"
    assert way_out(bench) == WAY_OUT


def test_a_model_that_asks_to_stop_ends_it_after_that_cycle(bench: Bench, script: SimpleNamespace) -> None:
    script.stops_at = 3
    bench.loop.run()
    assert len(bench.recorder.records) == 4
    assert bench.loop.stop_reason == "the model asked to stop"
    assert way_out(bench) == WAY_OUT


def test_nothing_is_sent_after_the_motors_are_off_on_the_way_out(bench: Bench) -> None:
    bench.loop.run(cycles=5)
    assert bench.hardware.sent[-1] == (20.0,)  # it was driving up to then
    assert "exchange" not in way_out(bench)
    assert not bench.hardware.armed


def test_a_model_that_raises_while_running_leaves_the_motors_off(bench: Bench, script: SimpleNamespace) -> None:
    bench.clock.events[3] = lambda: script.raises.update(equations=ZeroDivisionError("flat wheel"))
    text = r"^the model failed while running: ZeroDivisionError: flat wheel \(.*conftest\.py:\d+\)$"
    with pytest.raises(ModelFailedError, match=text):
        bench.loop.run()
    assert way_out(bench) == WAY_OUT
    assert not bench.hardware.armed
    assert [record.y[0] for record in bench.recorder.records[:3]] != [0.0] * 3
    last = bench.recorder.records[3]
    assert (last.cycle, list(last.commands)) == (3, [0.0])
    assert [(answer.call, answer.reasons[0][:33]) for answer in last.answers] == [
        ("model", "the model failed while running: Z")
    ]


def test_a_model_that_raises_at_its_end_does_so_with_the_motors_off_and_all_is_closed(
    bench: Bench, script: SimpleNamespace
) -> None:
    script.raises["final"] = ValueError("no end")
    with pytest.raises(ModelFailedError, match=r"^the model failed in its final equations: ValueError: no end \("):
        bench.loop.run(cycles=5)
    assert way_out(bench) == WAY_OUT


def test_a_model_that_raises_at_its_start_never_runs_and_the_hardware_is_closed(
    bench: Bench, script: SimpleNamespace
) -> None:
    script.raises["initial"] = KeyError("Mass")
    with pytest.raises(ModelFailedError, match=r"^the model failed in its initial equations: KeyError: 'Mass' \("):
        bench.loop.run(cycles=5)
    # Closing the hardware disarms it; see `Hardware.close`.
    assert bench.journal == ["open", "exchange", "initial", *AFTER_OPENING]
    assert bench.hardware.sent == [(0.0,)]
    assert bench.recorder.records == []


def test_hardware_that_does_not_open_ends_it_before_the_model_starts(bench: Bench) -> None:
    bench.hardware.raises["open"] = BusNotFoundError("no can0")
    with pytest.raises(BusNotFoundError, match=r"^no can0$"):
        bench.loop.run(cycles=5)
    assert bench.journal == ["open", *AFTER_OPENING]
    assert bench.hardware.sent == []


def test_a_link_lost_on_the_way_out_still_ends_the_model_and_closes_everything(bench: Bench) -> None:
    bench.hardware.raises["disarm"] = LinkLostError("the bus is gone")
    with pytest.raises(LinkLostError):
        bench.loop.run(cycles=3)
    assert way_out(bench) == WAY_OUT


def test_loop_stopped_before_it_runs_runs_no_cycle(bench: Bench) -> None:
    bench.loop.stop("too early")
    bench.loop.run()
    assert bench.recorder.records == []
    assert bench.journal == ["open", "exchange", "initial", *WAY_OUT]
