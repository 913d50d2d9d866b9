# SPDX-License-Identifier: MIT
"""What the safety section does to the real cycle; the checks themselves are tested in tests/node/safety."""

import itertools
import os
from collections.abc import Callable, Sequence
from types import SimpleNamespace

import msgspec
import pytest

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Mode, Transition
from segway_ecc.node.safety.settings import (
    ChecklistSettings,
    FollowingErrorSettings,
    GravitySettings,
    LateCyclesLimit,
    OscillationLimit,
    SafetySettings,
)
from segway_ecc.testing import Bench, RecordingHardware, ScriptedClock

MS = 1_000_000
G = 9.80665
SIGNALS = {
    "left.velocity": "rad/s",
    **{f"imu.angular_velocity_{axis}": "rad/s" for axis in "xyz"},
    **{f"imu.linear_acceleration_{axis}": "m/s2" for axis in "xyz"},
}
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, G)
LEANING = (0.0, 0.0, 0.0, 0.0, -6.0, 0.0, 7.75)


class Balancer(SectionedModel):
    """Torque as the script says."""

    name = "balancer"
    step_size = 0.01
    method = Method.DISCRETE
    inputs = (Variable("Speed", "rad/s"),)
    outputs = (Variable("Torque", "N.m"),)

    def __init__(self, script: SimpleNamespace) -> None:
        super().__init__()
        self.script = script
        self.cycle = -1

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        self.cycle += 1
        return s

    def output(self) -> Sequence[float]:
        return (self.script.outputs.get(self.cycle, 5.0),)


def sensors(values: tuple[float, ...], valid: tuple[bool, ...] = (True,) * 7) -> Sensors:
    return Sensors(values, (0.001,) * 7, valid)


@pytest.fixture
def balancer(script: SimpleNamespace) -> Callable[..., Bench]:
    """A bench whose model wants 5 N m, behind one motor of at most 30 N m, with an IMU that is still and upright."""

    def make(safety: SafetySettings, *, arm_at_start: bool = True, immediately: bool = False) -> Bench:
        hardware = RecordingHardware(SIGNALS, {"left.torque": "N.m"}, (30.0,))
        hardware.measured = sensors(STILL)
        wiring = {"Speed": "left.velocity", "Torque": "left.torque"}
        return Bench(
            Balancer(script),
            hardware,
            wiring,
            safety=safety,
            arm_at_start=arm_at_start,
            actuate_immediately=immediately,
        )

    return make


def quiet(**settings: object) -> SafetySettings:
    return SafetySettings(frozen_after_s=None, **settings)  # type: ignore[arg-type] # pairs from the tests below


def modes(bench: Bench) -> list[Mode]:
    return [record.mode for record in bench.recorder.records]


def commands(bench: Bench) -> list[float]:
    return [record.commands[0] for record in bench.recorder.records]


def measure(bench: Bench, cycle: int, snapshot: Sensors) -> None:
    bench.clock.events[cycle] = lambda: setattr(bench.hardware, "measured", snapshot)


@pytest.mark.parametrize("immediately", [False, True])
def test_a_tilt_beyond_its_limit_takes_the_torque_away_in_its_own_cycle(
    balancer: Callable[..., Bench], *, immediately: bool
) -> None:
    bench = balancer(quiet(tilt_limit_rad=0.5), immediately=immediately)
    measure(bench, 13, sensors((0.0, 0.0, 60.0, 0.0, 0.0, 0.0, 2.0 * G)))  # 0.6 rad in one period
    measure(bench, 14, sensors(STILL))
    bench.loop.run(cycles=18)
    assert modes(bench) == [Mode.ARMED] * 13 + [Mode.FAULT] * 5
    assert commands(bench) == [5.0] * 13 + [0.0] * 5
    assert bench.cycle.arming.modes.reason == "the body leans 0.54 rad, beyond 0.5 rad"
    assert bench.cycle.arming.modes.history[-1] == Transition(13, Mode.FAULT, bench.cycle.arming.modes.reason)


def test_a_signal_that_only_safety_needs_is_a_fault_when_it_is_lost(balancer: Callable[..., Bench]) -> None:
    bench = balancer(quiet(tilt_limit_rad=0.5))
    measure(bench, 3, sensors(STILL, (True, True, False, True, True, True, True)))
    bench.loop.run(cycles=5)
    assert modes(bench)[3] is Mode.FAULT
    assert bench.cycle.arming.modes.reason == "imu.angular_velocity_y is too old: 1 ms"


def test_both_links_lost_is_a_fault_whatever_is_watched(balancer: Callable[..., Bench]) -> None:
    bench = balancer(SafetySettings(tilt_limit_rad=0.5, frozen_after_s=None, checklist=None))
    bench.clock.events[3] = lambda: bench.hardware.raises.update(exchange=LinkLostError("both lines are gone"))
    bench.loop.run(cycles=5)
    assert (modes(bench)[3], bench.cycle.arming.modes.reason) == (Mode.FAULT, "both lines are gone")


def test_a_frozen_imu_takes_the_torque_away_within_a_tenth_of_a_second(balancer: Callable[..., Bench]) -> None:
    bench = balancer(SafetySettings())
    for cycle in range(20):
        measure(bench, cycle, sensors((0.0, 1e-4 * cycle, *STILL[2:])))
    bench.loop.run(cycles=40)
    assert modes(bench).index(Mode.FAULT) == 29  # the values of cycle 19, ten periods of 10 ms later
    assert "the IMU is frozen" in bench.cycle.arming.modes.reason


def test_late_cycles_in_a_row_take_the_torque_away(balancer: Callable[..., Bench]) -> None:
    bench = balancer(quiet(late_cycles_limit=LateCyclesLimit(in_a_row=3)))
    bench.clock.late_ns = dict.fromkeys(range(3, 6), 6 * MS)
    bench.loop.run(cycles=9)
    assert modes(bench).index(Mode.FAULT) == 5
    assert bench.cycle.arming.modes.reason == "3 deadlines in a row were missed, fewer than 3 are allowed"


def test_deadlines_that_were_skipped_take_the_torque_away_in_the_cycle_after(balancer: Callable[..., Bench]) -> None:
    bench = balancer(quiet(late_cycles_limit=LateCyclesLimit(in_a_row=3)))
    bench.stage.costs_ns[3] = 45 * MS  # of which four deadlines are skipped
    bench.loop.run(cycles=9)
    assert modes(bench).index(Mode.FAULT) == 4
    assert "deadlines in a row were missed" in bench.cycle.arming.modes.reason


def test_commands_keep_to_the_robot_s_own_limit_and_slew_rate_also_from_zero_at_arming(
    balancer: Callable[..., Bench], script: SimpleNamespace
) -> None:
    bench = balancer(quiet(max_command=4.0, command_slew=150.0), arm_at_start=False)
    script.outputs[7] = script.outputs[8] = -9.0
    bench.stage.send_request(2, Action.ARM)
    bench.stage.send_request(9, Action.STOP)
    bench.stage.send_request(10, Action.CLEAR_FAULT)
    bench.stage.send_request(11, Action.ARM)
    bench.loop.run(cycles=14)
    # 1.5 N m per cycle, up to 4; a stop is zero at once; armed again it begins at zero.
    expected = [0.0, 0.0, 1.5, 3.0, 4.0, 4.0, 4.0, 2.5, 1.0, 0.0, 0.0, 1.5, 3.0, 4.0]
    assert commands(bench) == pytest.approx(expected)


LIMITS = {"left.torque": 20.0}


@pytest.mark.parametrize("immediately", [False, True])
def test_an_output_beyond_its_limit_never_leaves(
    balancer: Callable[..., Bench], script: SimpleNamespace, *, immediately: bool
) -> None:
    bench = balancer(quiet(output_limits=LIMITS), immediately=immediately)
    script.outputs[3] = 1e308
    bench.loop.run(cycles=6)
    assert modes(bench) == [Mode.ARMED] * 3 + [Mode.FAULT] * 3
    assert commands(bench) == [5.0] * 3 + [0.0] * 3
    assert bench.loop.modes.reason == "the model gives left.torque 1e+308 N.m, allowed is -20 to 20 N.m"


def test_a_command_that_oscillates_takes_the_torque_away(
    balancer: Callable[..., Bench], script: SimpleNamespace
) -> None:
    bench = balancer(quiet(oscillation=OscillationLimit(amplitude=2.0, in_window=3)))
    script.outputs |= {cycle: 18.0 * (-1.0) ** cycle for cycle in range(4, 20)}
    bench.loop.run(cycles=10)
    # It was 5 N m until cycle 3, so that the first change is that to the cycle with -18 N m.
    assert modes(bench).index(Mode.FAULT) == 7
    assert bench.loop.modes.reason.startswith("left.torque oscillates: it changed its sign 3 times within 0.2 s")


def test_a_model_whose_outputs_are_absurd_is_started_anew_and_does_not_arm_until_they_are_not(
    balancer: Callable[..., Bench], script: SimpleNamespace
) -> None:
    bench = balancer(quiet(output_limits=LIMITS), arm_at_start=False)
    script.outputs |= dict.fromkeys(range(2, 6), 1e6)
    bench.stage.send_request(4, Action.ARM)
    bench.stage.send_request(8, Action.ARM)
    bench.loop.run(cycles=10)
    refused, armed = bench.stage.answers
    assert refused.message == (
        "model: the model gives left.torque 1e+06 N.m, allowed is -20 to 20 N.m; see its parameters and what it is "
        "wired to"
    )
    assert armed.accepted
    assert commands(bench) == [0.0] * 8 + [5.0] * 2
    assert "arm" not in bench.hardware.journal[:4]


class Counted(Balancer):
    """It counts its starts, by the cycle before each."""

    def initial(self) -> None:
        self.script.starts.append(self.cycle)


NOISE = (0.0, 3.0, 9.0, -5.0, 4.0, 20.0, -3.0, 0.0)


def test_a_model_is_started_anew_after_noise_of_an_imu_that_wakes_up_and_never_once_it_was_armed(
    script: SimpleNamespace,
) -> None:
    script.starts = []
    hardware = RecordingHardware({**SIGNALS, "right.velocity": "rad/s"}, {"left.torque": "N.m"}, (30.0,))
    gravity = GravitySettings(wheel_radius=0.1, imu_height=0.5, velocity_m_s=0.5, gyro_rad_s=0.1)
    bench = Bench(
        Counted(script),
        hardware,
        {"Speed": "left.velocity", "Torque": "left.torque"},
        safety=quiet(gravity=gravity, checklist=ChecklistSettings(still_s=0.05)),
        arm_at_start=False,
    )
    still = Sensors((*STILL, 0.0), (0.001,) * 8, (True,) * 8)
    noise = Sensors(NOISE, (0.001,) * 8, (True,) * 8)
    hardware.measured = noise
    for cycle, measured in ((3, still), (6, noise), (7, still), (140, noise), (142, still)):
        measure(bench, cycle, measured)
    bench.stage.send_request(6, Action.ARM)
    bench.stage.send_request(130, Action.ARM)
    bench.stage.send_request(135, Action.DISARM)
    bench.loop.run(cycles=150)
    refused, *accepted = bench.stage.answers
    assert "the IMU does not measure how the robot moves" in refused.message
    assert all(answer.accepted for answer in accepted)
    assert script.starts == [-1, 2, 6]


def test_a_limit_of_what_the_model_does_not_give_is_refused_at_the_start(balancer: Callable[..., Bench]) -> None:
    with pytest.raises(UnknownNameError, match=r"called 'right\.torque'; there is left\.torque$"):
        balancer(quiet(output_limits={"right.torque": 1.0}))


def test_lost_set_points_hold_and_do_not_cut(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(safety=SafetySettings(frozen_after_s=None, wheel_velocity_limit=None, max_command=20.0))
    bench.stage.send_setpoint(1, Setpoint(2.0, 1.0))
    bench.loop.run(cycles=60)
    assert modes(bench)[-1] is Mode.HOLD
    assert bench.hardware.journal.count("disarm") == 1, "by the end of the run"
    assert [(t.cycle, t.mode) for t in bench.cycle.arming.modes.history] == [(0, Mode.ARMED), (52, Mode.HOLD)]


def test_a_fault_wins_over_a_hold(balancer: Callable[..., Bench]) -> None:
    bench = balancer(quiet(tilt_limit_rad=0.5))
    bench.stage.send_setpoint(1, Setpoint(2.0, 1.0))
    measure(bench, 52, sensors((0.0, 0.0, 60.0, 0.0, 0.0, 0.0, 2.0 * G)))
    bench.loop.run(cycles=54)
    assert modes(bench)[51:] == [Mode.ARMED, Mode.FAULT, Mode.FAULT]


FOLLOWING = FollowingErrorSettings(track=0.5, wheel_radius=0.1, linear_window=0.2, settle_s=0.1, for_s=0.05)


@pytest.fixture
def follower(make_two: Callable[..., Bench]) -> Bench:
    """A robot that stands still whatever it is told, and whose following is watched."""
    return make_two(quiet(following_error=FOLLOWING))


@pytest.fixture
def make_two(script: SimpleNamespace) -> Callable[..., Bench]:
    """A bench with two wheels that are measured and one motor."""

    def make(safety: SafetySettings, *, arm_at_start: bool = True) -> Bench:
        hardware = RecordingHardware({"left.velocity": "rad/s", "right.velocity": "rad/s"}, {"m": "N.m"}, (30.0,))
        return Bench(
            Balancer(script),
            hardware,
            {"Speed": "left.velocity", "Torque": "m"},
            safety=safety,
            arm_at_start=arm_at_start,
        )

    return make


def test_a_robot_that_does_not_follow_loses_its_torque(follower: Bench) -> None:
    follower.stage.send_setpoint(20, Setpoint(1.0, 0.0))
    follower.loop.run(cycles=60)
    # Told in cycle 20, to be seen from 21 on; rest was last asked in cycle 20 and counts for 10 more, then 5 are wrong.
    assert modes(follower).index(Mode.FAULT) == 20 + 10 + 5
    assert follower.cycle.arming.modes.reason == "the robot goes 0.00 m/s ahead, asked is 1.00 to 1.00 m/s"


def test_a_robot_that_is_not_armed_has_nothing_to_follow(make_two: Callable[..., Bench]) -> None:
    bench = make_two(quiet(following_error=FOLLOWING), arm_at_start=False)
    bench.hardware.measured = Sensors((50.0, 50.0), (0.0, 0.0), (True, True))
    bench.stage.send_request(50, Action.ARM)
    bench.loop.run(cycles=60)
    assert [answer.accepted for answer in bench.stage.answers] == [True]
    assert bench.loop.modes.mode is Mode.ARMED
    bench = make_two(quiet(following_error=FOLLOWING))
    bench.hardware.measured = Sensors((50.0, 50.0), (0.0, 0.0), (True, True))
    bench.loop.run(cycles=60)
    assert bench.loop.modes.mode is Mode.FAULT, "at rest it was to be"


def test_a_robot_that_holds_must_come_to_rest(make_two: Callable[..., Bench]) -> None:
    bench = make_two(quiet(following_error=FOLLOWING))
    bench.hardware.measured = Sensors((10.0, 10.0), (0.0, 0.0), (True, True))
    bench.stage.send_setpoint(0, Setpoint(1.0, 0.0))
    bench.stage.send_setpoint(1, Setpoint(1.0, 0.0))
    bench.loop.run(cycles=100)
    found = [mode for mode, _ in itertools.groupby(modes(bench))]
    assert found == [Mode.ARMED, Mode.HOLD, Mode.FAULT]
    assert "the robot goes 1.00 m/s ahead, asked is 0.00 to 0.00 m/s" in bench.cycle.arming.modes.reason


def test_pre_arm_checks_refuse_until_the_robot_is_fit(balancer: Callable[..., Bench]) -> None:
    bench = balancer(quiet(checklist=ChecklistSettings()), arm_at_start=False)
    bench.hardware.measured = sensors(LEANING)
    bench.stage.send_request(105, Action.ARM)
    measure(bench, 106, sensors(STILL))
    bench.stage.send_request(107, Action.ARM)
    bench.stage.send_request(700, Action.ARM)
    bench.loop.run(cycles=702)
    leaning, drawn, fit = bench.stage.answers
    assert leaning.message == "tilt: 0.66 rad from upright, allowed is 0.2 rad; hold the robot upright"
    assert drawn.message.startswith("tilt: 0.6")
    assert fit.accepted
    assert modes(bench)[699:] == [Mode.DISARMED, Mode.ARMED, Mode.ARMED]


def test_a_robot_that_arms_itself_waits_for_the_second_in_which_its_rate_is_measured(
    balancer: Callable[..., Bench],
) -> None:
    bench = balancer(quiet(checklist=ChecklistSettings()))
    bench.loop.run(cycles=110)
    assert modes(bench).index(Mode.ARMED) == 100


def test_pre_arm_checks_are_in_the_diagnostics(balancer: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch) -> None:
    bench = balancer(quiet(checklist=ChecklistSettings()), arm_at_start=False)
    assert "check.rate" not in bench.loop.statuses()[0].values, "before the first cycle nothing was measured"
    monkeypatch.setattr(os, "sched_getscheduler", lambda _pid: os.SCHED_FIFO | os.SCHED_RESET_ON_FORK)
    bench.loop.run(cycles=102)
    values = bench.loop.statuses()[0].values
    assert {name: text for name, text in values.items() if name.startswith("check.")} == {
        "check.drives": "ok: no reason against it",
        "check.rate": "ok: 100.00 Hz of 100 Hz over the last second",
        "check.telemetry": "ok: the newest value is 1.0 ms old",
        "check.sensors": "ok: all values are fresh",
        "check.plausible": "ok: nothing against sensors and deadlines",
        "check.imu_still": "ok: still for 1.02 s of 0.5 s",
        "check.tilt": "ok: 0.00 rad from upright, allowed is 0.2 rad",
        "check.wheels_still": "ok: the faster turns at 0.00 rad/s, allowed is 0.5 rad/s",
        "check.real_time": "ok: granted",
    }


@pytest.mark.parametrize(
    ("policy", "word"),
    [(os.SCHED_OTHER, "warning"), (os.SCHED_FIFO, "ok"), (os.SCHED_RR, "ok"), (os.SCHED_IDLE, "warning")],
)
def test_real_time_priority_is_looked_up(
    balancer: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch, policy: int, word: str
) -> None:
    monkeypatch.setattr(os, "sched_getscheduler", lambda _pid: policy)
    bench = balancer(quiet(checklist=ChecklistSettings()), arm_at_start=False)
    bench.loop.run(cycles=1)
    assert bench.loop.statuses()[0].values["check.real_time"].startswith(word)


def test_a_check_of_what_the_hardware_does_not_measure_is_refused(make_bench: Callable[..., Bench]) -> None:
    with pytest.raises(ConfigurationError, match=r"safety.tilt_limit_rad needs 'imu.angular_velocity_x'"):
        make_bench(safety=SafetySettings(tilt_limit_rad=0.5))


def test_the_section_of_a_robot_file_reaches_its_cycle() -> None:
    file = msgspec.structs.replace(load_robot("cart-can"), safety=SafetySettings(tilt_limit_rad=0.5))
    robot = build_robot(file, ScriptedClock())
    with pytest.raises(ConfigurationError, match=r"safety\.tilt_limit_rad needs"):
        robot.loop(NoStage(), NoRecorder())
