# SPDX-License-Identifier: MIT
"""Whatever happens in whatever order, on the real cycle: commands, faults, time and recovery."""

import math
from types import SimpleNamespace
from typing import Final

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.safety.modes import ACTIVE, POSTURES, Action, Mode
from segway_ecc.node.safety.settings import LateCyclesLimit, SafetySettings, StationSettings
from segway_ecc.testing import Bench, RecordingHardware, ScriptedStage

STEP: Final = 0.01
MAX_COMMAND, DRIVE_LIMIT, SLEW = 8.0, 10.0, 100.0
G: Final = 9.80665
IMU: Final = [f"imu.{what}_{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
SIGNALS: Final = dict.fromkeys(["left.angle", "left.velocity", *IMU], "SI")
SAFETY: Final = SafetySettings(
    tilt_limit_rad=0.6,
    tilt_rate_limit=6.0,
    late_cycles_limit=LateCyclesLimit(in_a_row=4),
    max_command=MAX_COMMAND,
    command_slew=SLEW,
)
STATION: Final = StationSettings(timeout_s=0.2, disarm_after_s=0.4, names=("base",))
LOST: Final = "the base station is lost"
WANTED: Final = st.sampled_from([-1e9, -9.0, -3.0, 0.0, 0.5, 3.0, 9.0, 1e9])


class Robot(SectionedModel):
    """Wants the torques that the script says, whatever the mode."""

    name = "robot"
    step_size = STEP
    method = Method.DISCRETE
    inputs = (Variable("Speed", "rad/s"),)
    outputs = (Variable("Left", "N.m"), Variable("Right", "N.m"))

    def __init__(self, script: SimpleNamespace) -> None:
        super().__init__()
        self.script = script

    def dynamic(self, t: float, s: list[float]) -> list[float]:  # type: ignore[override] # a list is what it is given
        del t
        return s

    def output(self) -> tuple[float, float]:
        wanted: tuple[float, float] = self.script.wanted
        return wanted


class Operation(RuleBasedStateMachine):
    """A robot with every kind of watch, and an account of what it may do that knows only what was done to it."""

    def __init__(self) -> None:
        super().__init__()
        self.script = SimpleNamespace(wanted=(0.0, 0.0))
        self.hardware = RecordingHardware(SIGNALS, {"left.torque": "N.m", "right.torque": "N.m"}, (DRIVE_LIMIT,) * 2)
        wiring = {"Speed": "left.velocity", "Left": "left.torque", "Right": "right.torque"}
        self.bench = Bench(
            Robot(self.script), self.hardware, wiring, arm_at_start=False, safety=SAFETY, station=STATION
        )
        self.stage: ScriptedStage = self.bench.stage
        self.cycle = self.bench.cycle
        self.number = 0
        self.noise = 0
        self.sensor_values = [0.0] * 7 + [G]
        self.valid = True
        self.drive_faults: tuple[str, ...] = ()
        self.before = (0.0, 0.0)
        self.was_fault = self.cleared = self.asked_to_arm = False
        self.beats = False
        self.cycle.start()

    def pass_cycle(self, late: float = 0.0, skip: int = 0) -> None:
        """Let a cycle pass, `late` periods after its deadline, after `skip` that were lost."""
        self.was_fault = self.mode is Mode.FAULT
        self.noise += 1
        values = (*self.sensor_values[:2], self.sensor_values[2] + 1e-6 * (self.noise % 9), *self.sensor_values[3:])
        self.hardware.measured = Sensors(values, (0.001,) * 8, (self.valid,) * 8, self.drive_faults)
        period_ns = self.bench.period_ns
        start_ns = (self.number + skip) * period_ns + round(late * period_ns)
        self.bench.clock.spend(max(start_ns + 2_000_000_000 - self.bench.clock.now_ns(), 0))
        self.before = self.after
        if self.beats:
            self.stage.send_heartbeat(self.stage._cycle + 1)
        self.cycle.run(self.number, round(late * period_ns))
        self.number += 1 + skip

    @property
    def mode(self) -> Mode:
        return self.cycle.arming.modes.mode

    @property
    def after(self) -> tuple[float, float]:
        records = self.bench.recorder.records
        return tuple(records[-1].commands) if records else (0.0, 0.0)  # type: ignore[return-value] # two motors

    def ask(self, action: Action) -> None:
        self.asked_to_arm, self.cleared = action is Action.ARM, action is Action.CLEAR_FAULT
        self.stage.send_request(self.stage._cycle + 1, action)
        self.pass_cycle()

    @rule(wanted=st.tuples(WANTED, WANTED), cycles=st.integers(1, 8))
    def drive(self, wanted: tuple[float, float], cycles: int) -> None:
        self.script.wanted = wanted
        self.stage.send_setpoint(self.stage._cycle + 1, Setpoint(1.0, 0.0))
        self.asked_to_arm = self.cleared = False
        for _ in range(cycles):
            self.pass_cycle()
            self.nothing_is_exceeded()

    @rule()
    def fall_silent(self) -> None:
        self.asked_to_arm = self.cleared = False
        for _ in range(55):
            self.pass_cycle()
            self.nothing_is_exceeded()

    @rule(cycles=st.integers(1, 30))
    def be_watched_over(self, cycles: int) -> None:
        was = self.mode
        self.beats = True
        self.asked_to_arm = self.cleared = False
        for _ in range(cycles):
            self.pass_cycle()
            self.nothing_is_exceeded()
            assert self.cycle.arming.modes.reason != LOST or self.mode is Mode.DISARMED
        assert (self.mode in ACTIVE) == (was in ACTIVE)

    @rule(cycles=st.integers(1, 60))
    def lose_the_station(self, cycles: int) -> None:
        was, was_watched = self.mode, self.beats
        self.beats = False
        self.asked_to_arm = self.cleared = False
        for cycle in range(1, cycles + 1):
            self.pass_cycle()
            self.nothing_is_exceeded()
            if not was_watched or was not in ACTIVE:
                continue
            modes = self.cycle.arming.modes
            if cycle <= 20:
                assert self.mode in ACTIVE
                assert modes.reason != LOST
            else:
                assert (self.mode, modes.reason) == (Mode.HOLD if cycle <= 40 else Mode.DISARMED, LOST)
        if self.mode in ACTIVE and was_watched:  # it is back, or the robot disarms in the midst of another rule
            self.beats = True
            self.pass_cycle()
            assert self.mode in ACTIVE

    @rule(action=st.sampled_from(Action))
    def operate(self, action: Action) -> None:
        was = self.mode
        self.ask(action)
        if action in POSTURES:  # of a robot that has none
            wanted = set(ACTIVE) if was in ACTIVE else {was}
        elif action is Action.STOP or (was is Mode.FAULT and action is not Action.CLEAR_FAULT):
            wanted = {Mode.FAULT}
        elif action is Action.ARM or (action is Action.CLEAR_FAULT and was in ACTIVE):
            wanted = {Mode.ARMED, Mode.HOLD}
        else:
            wanted = {Mode.DISARMED}
        assert self.mode in wanted, "in the cycle in which it is taken"
        assert action is not Action.STOP or self.cycle.arming.modes.reason == "stop was pressed"

    @rule(action=st.sampled_from(Action))
    def operate_in_a_hold(self, action: Action) -> None:
        self.arm_from_anywhere()
        self.beats = True  # or the station is what it holds for, and not for ever
        self.drive((1.0, -1.0), 1)
        self.fall_silent()
        assert self.mode is Mode.HOLD
        self.operate(action)

    @rule()
    def arm_from_anywhere(self) -> None:
        self.ask(Action.CLEAR_FAULT)
        self.nothing_is_exceeded()
        self.ask(Action.ARM)
        assert self.mode in ACTIVE

    def trouble(self) -> None:
        was_active = self.mode in ACTIVE
        self.asked_to_arm = self.cleared = False
        self.pass_cycle()
        assert self.mode is (Mode.FAULT if was_active or self.was_fault else Mode.DISARMED)
        assert self.after == (0.0, 0.0), "to zero at once, whatever the slew rate"

    @rule()
    def lose_the_sensors(self) -> None:
        self.valid = False
        self.trouble()
        self.valid = True

    @rule()
    def report_a_drive_fault(self) -> None:
        self.drive_faults = ("left drive: too hot",)
        self.trouble()
        self.drive_faults = ()

    @rule()
    def tilt_too_fast(self) -> None:
        for rate in (7.0, -7.0):  # and back: nine times 0.07 rad are a robot that lies, and must not arm
            self.sensor_values[3] = rate
            self.trouble()
        self.sensor_values[3] = 0.0

    @rule()
    def fall(self) -> None:
        for up in ([-G, 0.0, 0.0], [0.0, 0.0, G]):
            self.sensor_values[2:] = [0.0, 0.0, 0.0, *up]
            for self.valid in (False, True):  # without the IMU for so long, the estimate begins anew, with as many
                for _ in range(11):
                    self.trouble()

    @rule()
    def lose_every_link(self) -> None:
        self.asked_to_arm = self.cleared = False
        self.hardware.raises["exchange"] = LinkLostError("both lines are gone")
        self.pass_cycle()
        self.hardware.raises.clear()
        assert self.mode is Mode.FAULT

    @rule()
    def want_what_is_no_number(self) -> None:
        self.asked_to_arm = self.cleared = False
        self.script.wanted = (math.nan, 1.0)
        self.pass_cycle()
        self.script.wanted = (1.0, 1.0)
        assert self.mode is Mode.FAULT

    @rule(skip=st.integers(4, 9))
    def stall(self, skip: int) -> None:
        was_active = self.mode in ACTIVE
        self.asked_to_arm = self.cleared = False
        self.pass_cycle(skip=skip)
        assert not was_active or self.mode is Mode.FAULT

    @rule(late=st.floats(0.0, 0.9), skip=st.integers(0, 1))
    def stumble(self, late: float, skip: int) -> None:
        was_active = self.mode in ACTIVE
        self.asked_to_arm = self.cleared = False
        self.pass_cycle()
        self.pass_cycle(late=late, skip=skip)
        self.pass_cycle()
        assert self.mode in ACTIVE if was_active else self.mode not in ACTIVE

    @invariant()
    def nothing_is_exceeded(self) -> None:
        if self.mode not in ACTIVE:
            assert self.after == (0.0, 0.0)
            return
        for old, new in zip(self.before, self.after, strict=True):
            assert abs(new) <= MAX_COMMAND
            assert abs(new - old) <= SLEW * STEP * (1 + 1e-9)

    @invariant()
    def what_leaves_is_what_was_worked_out(self) -> None:
        for record, sent in zip(self.bench.recorder.records, self.hardware.sent[2:], strict=False):
            # An exchange that a lost link swallowed is noted as sent all the same, and is zero afterwards.
            assert sent == record.commands

    @invariant()
    def only_a_clear_leads_out_of_fault_and_never_to_armed(self) -> None:
        if self.was_fault:
            assert self.mode is (Mode.DISARMED if self.cleared else Mode.FAULT)

    @invariant()
    def the_motors_are_on_only_in_an_active_mode(self) -> None:
        assert self.hardware.armed == (self.mode in ACTIVE)

    @invariant()
    def the_history_ends_with_the_present_mode(self) -> None:
        modes = self.cycle.arming.modes
        assert not modes.history or (modes.history[-1].mode, modes.history[-1].reason) == (modes.mode, modes.reason)
        for earlier, later in zip(modes.history, list(modes.history)[1:], strict=False):
            assert earlier.cycle <= later.cycle
            assert (earlier.mode, later.mode) != (Mode.FAULT, Mode.ARMED)


Operation.TestCase.settings = settings(derandomize=True, deadline=None, max_examples=150, stateful_step_count=40)
TestOperation = Operation.TestCase
