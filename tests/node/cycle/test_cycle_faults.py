# SPDX-License-Identifier: MIT
"""What a cycle does where something is wrong; the rest is in test_cycle.py."""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.safety.modes import ACTIVE, Action, Answer, Mode
from segway_ecc.testing import Bench, RecordingHardware

FAST = Setpoint(2.0, 1.0)
FRESH = Sensors((0.0,), (0.001,), (True,))
STALE = Sensors((0.0,), (0.0312,), (False,))
BROKEN = Sensors((0.0,), (0.001,), (True,), ("the drive is too hot",))
NOT_FINITE = [math.nan, math.inf, -math.inf]
Trouble = Callable[[Bench, SimpleNamespace, int], None]


def stop(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del script
    bench.stage.send_request(cycle, Action.STOP)


def disarm(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del script
    bench.stage.send_request(cycle, Action.DISARM)


def stale(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del script
    bench.clock.events[cycle] = lambda: setattr(bench.hardware, "measured", STALE)
    bench.clock.events[cycle + 1] = lambda: setattr(bench.hardware, "measured", FRESH)


def broken(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del script
    bench.clock.events[cycle] = lambda: setattr(bench.hardware, "measured", BROKEN)
    bench.clock.events[cycle + 1] = lambda: setattr(bench.hardware, "measured", FRESH)


def lost(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del script
    bench.clock.events[cycle] = lambda: bench.hardware.raises.update(exchange=LinkLostError("the bus is gone"))
    bench.clock.events[cycle + 1] = bench.hardware.raises.clear


def bad_command(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del bench
    script.outputs[cycle] = (math.nan, 0.0)


def bad_output(bench: Bench, script: SimpleNamespace, cycle: int) -> None:
    del bench
    script.outputs[cycle] = (5.0, math.nan)


FAULTS: dict[str, tuple[Trouble, str]] = {
    "stop": (stop, "stop was pressed"),
    "stale sensor": (stale, "left.velocity is too old: 31 ms"),
    "drive fault": (broken, "the drive is too hot"),
    "link lost": (lost, "the bus is gone"),
    "command not finite": (bad_command, "output 'Voltage' of the model is not finite"),
    "output not finite": (bad_output, "output 'X' of the model is not finite"),
}
WAYS_OUT: dict[str, Trouble] = {"disarm": disarm} | {name: trouble for name, (trouble, _) in FAULTS.items()}


def modes(bench: Bench) -> list[Mode]:
    return [record.mode for record in bench.recorder.records]


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("immediately", [False, True])
def test_a_fault_gives_zero_in_its_own_cycle_and_stays(
    make_bench: Callable[..., Bench], script: SimpleNamespace, name: str, *, immediately: bool
) -> None:
    bench = make_bench(actuate_immediately=immediately)
    trouble, reason = FAULTS[name]
    bench.stage.send_setpoint(2, FAST)
    bench.stage.send_setpoint(7, FAST)
    trouble(bench, script, 5)
    bench.loop.run(cycles=10)
    assert modes(bench) == [Mode.ARMED] * 5 + [Mode.FAULT] * 5
    assert bench.cycle.arming.modes.reason == reason
    assert bench.recorder.records[4].commands != (0.0,)
    assert [record.commands for record in bench.recorder.records[5:]] == [(0.0,)] * 5
    assert bench.hardware.sent[-4:] == [(0.0,)] * 4


@pytest.mark.parametrize("value", NOT_FINITE)
def test_a_command_that_is_not_finite_never_leaves(bench: Bench, script: SimpleNamespace, value: float) -> None:
    script.outputs[3] = (value, 0.0)
    bench.loop.run(cycles=6)
    assert modes(bench)[3] is Mode.FAULT
    assert set(bench.hardware.sent) == {(0.0,)}
    assert not bench.hardware.armed


@pytest.mark.parametrize("name", WAYS_OUT)
def test_whatever_takes_the_torque_away_switches_the_motors_off_in_its_own_cycle(
    bench: Bench, script: SimpleNamespace, name: str
) -> None:
    armed: list[bool] = []
    WAYS_OUT[name](bench, script, 5)
    bench.clock.events.setdefault(8, lambda: armed.append(bench.hardware.armed))
    bench.loop.run(cycles=9)
    assert modes(bench)[5] not in ACTIVE
    assert armed == [False]


@pytest.mark.parametrize("name", WAYS_OUT)
def test_whatever_removes_torque_discards_every_set_point(bench: Bench, script: SimpleNamespace, name: str) -> None:
    bench.stage.send_setpoint(2, FAST)
    bench.stage.send_setpoint(2, FAST, bench.clock.wall_ns() + 15 * bench.period_ns)
    WAYS_OUT[name](bench, script, 5)
    bench.stage.send_request(8, Action.CLEAR_FAULT)
    bench.stage.send_request(9, Action.ARM)
    bench.loop.run(cycles=20)
    assert modes(bench)[9:] == [Mode.ARMED] * 11
    # In cycle 5 itself a set-point was in force where only its own command showed that something is wrong.
    assert [record.setpoint for record in bench.recorder.records[6:]] == [REST] * 14


def test_disarm_and_arm_in_one_cycle_discard_earlier_set_points(bench: Bench) -> None:
    bench.stage.send_setpoint(2, FAST)
    bench.stage.send_request(5, Action.DISARM)
    bench.stage.send_request(5, Action.ARM)
    bench.loop.run(cycles=8)
    assert [record.setpoint for record in bench.recorder.records[5:]] == [REST] * 3


@pytest.mark.parametrize("sensors", [STALE, BROKEN])
def test_arming_into_a_fault_is_refused_and_the_motors_switched_off(
    make_bench: Callable[..., Bench], sensors: Sensors
) -> None:
    bench = make_bench(arm_at_start=False)
    armed: list[bool] = []
    bench.hardware.measured = sensors
    bench.stage.send_request(2, Action.ARM)
    bench.clock.events[4] = lambda: armed.append(bench.hardware.armed)
    bench.loop.run(cycles=5)
    assert modes(bench) == [Mode.DISARMED] * 5
    assert [answer.accepted for answer in bench.stage.answers] == [False]
    assert armed == [False]


def test_what_is_wrong_while_disarmed_is_no_fault_yet(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(arm_at_start=False)
    bench.hardware.measured = STALE
    bench.loop.run(cycles=3)
    assert modes(bench) == [Mode.DISARMED] * 3


def test_a_sensor_that_the_model_does_not_use_may_be_stale(bench: Bench) -> None:
    # Wired for its own sake only: the model's one input is put on a set-point.
    spare = Sensors((0.0,), (9.0,), (False,))
    rewired = {"Speed": "setpoint.linear_velocity", "Voltage": "left.voltage"}
    other = Bench(bench.model, bench.hardware, rewired)
    other.hardware.measured = spare
    other.loop.run(cycles=3)
    assert modes(other) == [Mode.ARMED] * 3


@pytest.mark.parametrize("immediately", [False, True])
def test_what_the_model_wants_while_disarmed_is_not_sent(
    make_bench: Callable[..., Bench], script: SimpleNamespace, *, immediately: bool
) -> None:
    bench = make_bench(arm_at_start=False, actuate_immediately=immediately)
    script.outputs = dict.fromkeys(range(8), (5.0, 0.0))
    bench.stage.send_request(3, Action.ARM)
    bench.stage.send_request(5, Action.DISARM)
    bench.loop.run(cycles=8)
    wanted = [(0.0,)] * 3 + [(5.0,)] * 2 + [(0.0,)] * 3
    assert [record.commands for record in bench.recorder.records] == wanted
    delay = 1 if immediately else 2
    assert bench.hardware.sent == ([(0.0,)] * delay + wanted)[:9]


def test_stop_is_latched_until_it_is_cleared(bench: Bench) -> None:
    for cycle, action in enumerate((Action.STOP, Action.ARM, Action.DISARM, Action.CLEAR_FAULT, Action.ARM), start=2):
        bench.stage.send_request(cycle, action)
    bench.loop.run(cycles=7)
    assert modes(bench)[1:] == [Mode.ARMED, *[Mode.FAULT] * 3, Mode.DISARMED, Mode.ARMED]
    assert bench.stage.answers[1] == Answer(accepted=False, message="clear the fault first: stop was pressed")


def test_a_lost_link_keeps_the_last_values_which_grow_old_and_are_not_valid(bench: Bench) -> None:
    bench.hardware.measured = Sensors((123.4,), (0.001,), (True,))
    bench.clock.events[3] = lambda: bench.hardware.raises.update(exchange=LinkLostError("the bus is gone"))
    bench.loop.run(cycles=6)
    before, *lost = (record.sensors for record in bench.recorder.records[2:])
    period_s = bench.period_ns * 1e-9
    assert before.values == (123.4,)
    for missed, sensors in enumerate(lost, start=1):
        assert sensors.values == (123.4,)
        assert sensors.ages == pytest.approx((before.ages[0] + missed * period_s,))
        assert (sensors.valid, sensors.faults) == ((False,), ("the bus is gone",))
        assert not sensors.ready
        assert not sensors.off


def test_events_of_the_exchange_that_sends_are_in_the_record_of_the_next_cycle(
    make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(actuate_immediately=True)
    exchange, count = bench.hardware.exchange, 0

    def eventful(commands: Sequence[float] | None) -> Sensors:
        nonlocal count
        count += 1
        return msgspec.structs.replace(exchange(commands), events=(f"event {count}",))

    monkeypatch.setattr(bench.hardware, "exchange", eventful)
    bench.loop.run(cycles=3)
    assert [record.sensors.events for record in bench.recorder.records] == [
        ("event 2",),
        ("event 3", "event 4"),
        ("event 5", "event 6"),
    ]


def test_a_link_lost_between_the_two_exchanges_of_a_cycle_is_a_fault_too(
    make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(actuate_immediately=True)
    exchange = bench.hardware.exchange

    def half_lost(commands: Sequence[float] | None) -> Sensors:
        if commands is not None and len(bench.clock.woken_ns) == 4:
            raise LinkLostError("the bus is gone")
        return exchange(commands)

    monkeypatch.setattr(bench.hardware, "exchange", half_lost)
    bench.loop.run(cycles=6)
    assert modes(bench)[4:] == [Mode.FAULT] * 2


EVENTS: dict[str, Trouble] = {
    **WAYS_OUT,
    "arm": lambda bench, _script, cycle: bench.stage.send_request(cycle, Action.ARM),
    "clear": lambda bench, _script, cycle: bench.stage.send_request(cycle, Action.CLEAR_FAULT),
    "drive": lambda bench, _script, cycle: bench.stage.send_setpoint(cycle, FAST),
}


@given(st.lists(st.sampled_from(sorted(EVENTS)), max_size=40), st.booleans())
@settings(derandomize=True, max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_nothing_but_zero_is_ever_sent_unless_armed_or_holding(
    make_bench: Callable[..., Bench],
    script: SimpleNamespace,
    happenings: list[str],
    immediately: bool,  # noqa: FBT001 - hypothesis passes by position
) -> None:
    # Half of the time the model wants torque whatever the set-point, as a balancing one does.
    script.outputs = dict.fromkeys(range(0, 50, 2), (5.0, 0.0))
    bench = make_bench(actuate_immediately=immediately)
    for cycle, name in enumerate(happenings, start=1):
        EVENTS[name](bench, script, cycle)
    bench.loop.run(cycles=len(happenings) + 3)
    sent = bench.hardware.sent[1:] if immediately else bench.hardware.sent[2:]
    for record, left in zip(bench.recorder.records, sent, strict=False):
        assert math.isfinite(record.commands[0])
        if record.mode not in ACTIVE:
            assert record.commands == (0.0,)
        assert left == record.commands


def test_stale_measurement_reaches_the_stage_as_nan(bench: Bench) -> None:
    stale(bench, SimpleNamespace(), 3)
    bench.loop.run(cycles=5)
    reported, recorded = ([values[-1] for values in found] for found in zip(*published(bench), strict=True))
    assert [math.isnan(value) for value in reported] == [False, False, False, True, False]
    assert [math.isnan(value) for value in recorded] == [False, False, False, True, False]


def published(bench: Bench) -> list[tuple[Sequence[float], Sequence[float]]]:
    pairs = zip(bench.stage.reports, bench.recorder.records, strict=True)
    return [(report.values, record.published) for report, record in pairs]


@pytest.mark.parametrize("immediately", [False, True])
def test_link_events_of_every_exchange_are_logged_once(
    make_bench: Callable[..., Bench],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    *,
    immediately: bool,
) -> None:
    bench = make_bench(actuate_immediately=immediately)
    exchanges: list[str] = []

    def exchange(commands: Sequence[float] | None) -> Sensors:
        del commands
        exchanges.append(f"exchange {len(exchanges)} changed lines")
        return msgspec.structs.replace(FRESH, events=(exchanges[-1],))

    monkeypatch.setattr(bench.hardware, "exchange", exchange)
    bench.loop.run(cycles=3)
    assert len(exchanges) == (7 if immediately else 4)  # one before the first cycle
    assert [text for text in caplog.messages if "changed lines" in text] == exchanges


class Integrator(SectionedModel):
    """Sums its input: what is not finite stays so until the model is initialized."""

    name = "integrator"
    step_size = 0.01
    method = Method.DISCRETE
    inputs = (Variable("Speed", "rad/s"),)
    states = (Variable("Sum", "rad"),)
    outputs = (Variable("Voltage", "V"),)

    def input(self, u: Sequence[float]) -> None:
        (self.speed,) = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        return (s[0] + self.speed,)

    def output(self) -> Sequence[float]:
        return self.s


def test_model_that_gave_nan_is_initialized_when_the_fault_is_cleared() -> None:
    hardware = RecordingHardware({"left.velocity": "rad/s"}, {"left.voltage": "V"}, (30.0,))
    bench = Bench(Integrator(), hardware, {"Speed": "left.velocity", "Voltage": "left.voltage"})
    bench.clock.events[2] = lambda: setattr(hardware, "measured", Sensors((math.nan,), (0.001,), (True,)))
    bench.clock.events[3] = lambda: setattr(hardware, "measured", FRESH)
    bench.stage.send_request(5, Action.CLEAR_FAULT)
    bench.stage.send_request(6, Action.ARM)
    bench.loop.run(cycles=9)
    assert modes(bench)[1:] == [Mode.ARMED, *[Mode.FAULT] * 3, Mode.DISARMED, *[Mode.ARMED] * 3]
    outputs = [record.y[0] for record in bench.recorder.records]
    assert [math.isnan(value) for value in outputs] == [False, False, True, True, True, *[False] * 4]


NEVER = Sensors((0.0,), (math.inf,), (False,), ready=False, unseen=("left.velocity",))


@pytest.mark.parametrize(
    ("once_ready", "mode"), [(FRESH, Mode.ARMED), (msgspec.structs.replace(NEVER, ready=True), Mode.DISARMED)]
)
def test_what_a_drive_measures_only_once_it_is_on_is_awaited_and_then_needed(
    make_bench: Callable[..., Bench], once_ready: Sensors, mode: Mode
) -> None:
    bench = make_bench(arm_at_start=False)
    bench.hardware.measured = NEVER
    bench.stage.send_request(2, Action.ARM)
    bench.clock.events[6] = lambda: setattr(bench.hardware, "measured", once_ready)
    bench.loop.run(10)

    assert modes(bench)[:6] == [Mode.DISARMED] * 6
    assert modes(bench)[-1] is mode
    assert [answer.accepted for answer in bench.stage.answers] == [mode is Mode.ARMED]
