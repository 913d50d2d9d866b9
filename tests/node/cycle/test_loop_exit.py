# SPDX-License-Identifier: MIT
"""How the loop ends, and what it leaves behind; the rest is in test_loop.py."""

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.safety.modes import Mode
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
    text = r"^model 'probe' failed in cycle 3 while running: ZeroDivisionError: flat wheel \(.*conftest\.py:\d+\)$"
    with pytest.raises(ModelFailedError, match=text):
        bench.loop.run()
    assert way_out(bench) == WAY_OUT
    assert not bench.hardware.armed
    assert [record.y[0] for record in bench.recorder.records[:3]] != [0.0] * 3
    last = bench.recorder.records[3]
    assert (last.cycle, last.mode, list(last.commands)) == (3, Mode.FAULT, [0.0])
    assert list(last.u) == [0.0], "what the model was given"
    assert [(answer.call, answer.reasons[0][:49]) for answer in last.answers] == [
        ("model", "model 'probe' failed in cycle 3 while running: Ze")
    ]
    told = bench.stage.reports[-1]
    assert (told.cycle, told.mode, told.is_zero, told.drives) == (4, Mode.FAULT, True, "unconfirmed")
    assert told.reason == bench.loop.modes.reason == last.answers[0].reasons[0]


@pytest.mark.parametrize("error", [SystemExit(0), RecursionError("too deep"), StopIteration(), GeneratorExit()])
def test_whatever_a_model_raises_is_a_fault(bench: Bench, script: SimpleNamespace, error: BaseException) -> None:
    bench.clock.events[3] = lambda: script.raises.update(equations=error)
    with pytest.raises(
        ModelFailedError, match=f"^model 'probe' failed in cycle 3 while running: {type(error).__name__}"
    ):
        bench.loop.run()
    assert way_out(bench) == WAY_OUT
    assert bench.recorder.records[-1].mode is bench.loop.modes.mode is Mode.FAULT


def test_a_text_of_a_model_that_no_log_holds_is_recorded_with_an_escape(bench: Bench, script: SimpleNamespace) -> None:
    bench.clock.events[3] = lambda: script.raises.update(equations=ValueError("half \ud800 of a pair"))
    with pytest.raises(ModelFailedError, match=r"ValueError: half \\ud800 of a pair \("):
        bench.loop.run()
    assert bench.stage.reports[-1].reason.isascii()


@pytest.mark.parametrize("outputs", [(), (1.0,), (1.0, 2.0, 3.0), (None, 1.0), ("a", 1.0), (1j, 0.0), (10**400, 0)])
def test_outputs_that_are_not_as_many_numbers_as_declared_are_a_fault(
    bench: Bench, script: SimpleNamespace, outputs: object
) -> None:
    script.outputs[3] = outputs
    with pytest.raises(ModelFailedError, match=r"^model 'probe' failed in cycle 3 while running: "):
        bench.loop.run(cycles=9)
    assert way_out(bench) == WAY_OUT
    assert bench.recorder.records[-1].mode is Mode.FAULT


def test_a_variable_that_cannot_be_read_for_its_topic_is_a_fault(
    make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(rewired={"X": "topic.x"})

    def read(_name: str) -> float:
        raise LookupError("gone")

    bench.clock.events[3] = lambda: monkeypatch.setattr(bench.model, "read", read)
    with pytest.raises(
        ModelFailedError, match=r"^model 'probe' failed in cycle 3 when 'X' was read: LookupError: gone"
    ):
        bench.loop.run(cycles=9)
    assert way_out(bench) == WAY_OUT
    assert bench.recorder.records[-1].mode is Mode.FAULT


def test_final_equations_that_fail_after_the_model_did_do_not_hide_why_it_ended(
    bench: Bench, script: SimpleNamespace, caplog: pytest.LogCaptureFixture
) -> None:
    script.raises["final"] = ValueError("no end")
    bench.clock.events[3] = lambda: script.raises.update(equations=ZeroDivisionError("flat wheel"))
    with pytest.raises(ModelFailedError, match="flat wheel"):
        bench.loop.run()
    assert way_out(bench) == WAY_OUT
    assert "failed in cycle 3 in its final equations: ValueError: no end" in caplog.text


def test_a_model_that_raises_at_its_end_does_so_with_the_motors_off_and_all_is_closed(
    bench: Bench, script: SimpleNamespace
) -> None:
    script.raises["final"] = ValueError("no end")
    with pytest.raises(ModelFailedError, match=r"^model 'probe' failed in cycle 4 in its final .*: no end \("):
        bench.loop.run(cycles=5)
    assert way_out(bench) == WAY_OUT


def test_a_model_that_raises_at_its_start_never_runs_and_the_hardware_is_closed(
    bench: Bench, script: SimpleNamespace
) -> None:
    script.raises["initial"] = KeyError("Mass")
    with pytest.raises(ModelFailedError, match=r"^model 'probe' failed in its initial equations: KeyError: 'Mass' \("):
        bench.loop.run(cycles=5)
    # Closing the hardware disarms it; see `Hardware.close`.
    assert bench.journal == ["open", "exchange", "initial", "take", "final", *AFTER_OPENING]
    assert bench.hardware.sent == [(0.0,)]
    (last,) = bench.recorder.records
    assert (last.mode, last.answers[0].call, last.initial) == (Mode.FAULT, "model", last.sensors)


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
