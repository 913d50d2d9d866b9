# SPDX-License-Identifier: MIT
"""One cycle of the robot: exchange, ROS stage, decide, equations, limit."""

import math
import traceback
from collections import deque
from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.interfaces import (
    MODEL_CALL,
    PHASES,
    CycleRecord,
    HardwareAnswer,
    Inbox,
    NoRecorder,
    Recorder,
    Report,
    Stage,
    StampedSetpoint,
)
from segway_ecc.node.cycle.real_time import is_real_time
from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal, SetpointSchedule
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.supervision import Supervision
from segway_ecc.node.cycle.timing import Histogram, Tally, TimeBase
from segway_ecc.node.cycle.trajectory import TrajectoryFollower
from segway_ecc.node.cycle.wiring import Wiring
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.model.model import Model
from segway_ecc.node.safety.limiter import CommandLimiter, not_finite
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.pre_arm import PreArmCheck, drives_check
from segway_ecc.node.safety.settings import NOTHING_WATCHED, SafetySettings, StationSettings

LATENESS: Final = "lateness"
WHOLE: Final = "cycle"
_EVENTS_KEPT: Final = 64


class BestEffortRecorder:
    """Stands in front of a recorder and never raises: recording is worth less than control; see `Recorder`.

    Once the recorder has failed nothing more is given to it, and that is logged once; it is closed all the same.
    """

    def __init__(self, recorder: Recorder, events: deque[str]) -> None:
        """Append to `events` what happens to `recorder`."""
        self._opened = recorder
        self._recorder = recorder
        self._events = events

    def write(self, record: CycleRecord) -> None:
        """Keep one cycle, while that can be done."""
        try:
            self._recorder.write(record)
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot must not fall for it
            self._do_without(error)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep a set of diagnostics, while that can be done."""
        try:
            self._recorder.write_diagnostics(stamp_ns, statuses)
        except Exception as error:  # noqa: BLE001 - as above
            self._do_without(error)

    def close(self) -> None:
        """Finish the log, as far as that can be done."""
        try:
            self._opened.close()
        except Exception as error:  # noqa: BLE001 - as above
            self._do_without(error)

    def _do_without(self, error: Exception) -> None:
        if not isinstance(self._recorder, NoRecorder):
            self._events.append(f"recording has ended: {type(error).__name__}: {error}")
        self._recorder = NoRecorder()


class Cycle:
    """The parts of a robot, run once per period in their fixed order.

    Attributes:
        trajectories: The whole manoeuvre that is followed, if one is.
        time_base: The stamp of each cycle.
        sensors: The newest snapshot of the hardware; None before the first.
        events: What happened to the links and has not been logged yet; of more than 64 the oldest is discarded.
        recorder: Keeps the cycles, as long as it can.
    """

    def __init__(  # noqa: PLR0913 - the interfaces of the robot, each named at the one place that joins them
        self,
        *,
        model: Model,
        hardware: Hardware,
        wiring: Wiring,
        schedule: SetpointSchedule,
        trajectories: TrajectoryFollower,
        time_base: TimeBase,
        clock: Clock,
        stage: Stage,
        recorder: Recorder,
        arm_at_start: bool,
        actuate_immediately: bool,
        safety: SafetySettings | None = None,
        station: StationSettings | None = None,
    ) -> None:
        """Join the parts; nothing is opened yet.

        Raises:
            ConfigurationError: `safety` asks for a check of a signal that the hardware does not measure.
            UnknownNameError: `station` sets a value that is not wired.
        """
        self.arming = ArmingManager(hardware, schedule, arm_at_start=arm_at_start, checklist=self._pre_arm_checks)
        self.schedule = schedule
        self.trajectories = trajectories
        self.time_base = time_base
        self.hardware = hardware
        self.sensors: Sensors | None = None
        self.events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self.recorder = BestEffortRecorder(recorder, self.events)
        self._tally = Tally((LATENESS, *PHASES, WHOLE))
        self._model = model
        self._wiring = wiring
        self._clock = clock
        self._stage = stage
        self._immediately = actuate_immediately
        watched, period_ns = safety or NOTHING_WATCHED, time_base.period_ns
        self._signal_names = list(hardware.signals)
        self._monitor = SafetyMonitor(watched, self._signal_names, wiring.sensors, period_ns)
        self._limiter = CommandLimiter(hardware.limits, watched.max_command, watched.command_slew, period_ns * 1e-9)
        self._zero = (0.0,) * len(hardware.commands)
        self._commands: Sequence[float] = self._zero
        self._y: list[float] = []
        self._set_values = list(wiring.set_values)
        self._applied: StampedSetpoint | None = None
        self._followed: Setpoint | None = None
        self._initial: Sensors | None = None
        self._start_ns = self._measured_ns = 0
        self._sent_events: tuple[str, ...] = ()
        self._supervision = Supervision(station, wiring.set_names, self.arming, period_ns)

    def start(self) -> None:
        """Open the hardware and run the initial and static equations under what it measures first."""
        self.hardware.open()
        self._measured_ns = self._clock.now_ns()
        self._initial = self.sensors = self.hardware.exchange(self._zero)
        self.events.extend(self._initial.events)
        self._initialize(self._initial)

    def run(self, cycle: int, lateness_ns: int) -> None:
        """Run cycle number `cycle`, which started `lateness_ns` after its deadline.

        Raises:
            ModelFailedError: The model's own equations raised.
        """
        now_ns, arming = self._clock.now_ns, self.arming
        start_ns = self._start_ns = now_ns()
        stamp_ns = self.time_base.stamp_ns(cycle)
        arming.modes.cycle, arming.answers = cycle, []
        sensors = self._exchange(None if self._immediately else self._commands)
        if self._sent_events:
            sensors = replace(sensors, events=(*self._sent_events, *sensors.events))
            self._sent_events = ()
        self.sensors = sensors
        exchanged_ns = now_ns()
        inbox = self._stage.take_inbox()
        published = self._publish(cycle, stamp_ns, sensors, inbox, exchanged_ns)
        published_ns = now_ns()
        self._monitor.look(sensors.values, sensors.valid, start_ns, lateness_ns, self._followed)
        try:
            setpoint = self._decide(cycle, inbox, sensors)
            self._applied = StampedSetpoint(setpoint, stamp_ns) if self.schedule.came_into_force(cycle) else None
            decided_ns = now_ns()
            u = self._compute(sensors, setpoint)
        except ModelFailedError as error:
            # What led to it is in the log, so that a replay fails in the same cycle.
            arming.answers.append(HardwareAnswer(MODEL_CALL, (str(error),)))
            no_input, no_time = (math.nan,) * len(self._model.inputs), (0,) * (len(PHASES) - 1)
            record = CycleRecord(
                cycle, stamp_ns, arming.modes.mode, lateness_ns, sensors, REST, no_input, self._y, self._zero,
                published, no_time, start_ns, inbox, arming.answers, self._initial,
            )  # fmt: skip
            self.recorder.write(record)
            raise
        computed_ns = now_ns()
        commands = self._actuate()
        actuated_ns = now_ns()
        durations_ns = (
            exchanged_ns - start_ns,
            published_ns - exchanged_ns,
            decided_ns - published_ns,
            computed_ns - decided_ns,
            actuated_ns - computed_ns,
        )
        mode, y, answers, initial = arming.modes.mode, self._y, arming.answers, self._initial
        # In the order of the fields: by their names takes four times as long.
        record = CycleRecord(
            cycle, stamp_ns, mode, lateness_ns, sensors, setpoint, u, y, commands, published, durations_ns, start_ns,
            inbox, answers, initial,
        )  # fmt: skip
        self.recorder.write(record)
        self._initial = None
        end_ns = now_ns()
        self._tally.note((lateness_ns, *durations_ns, end_ns - actuated_ns, end_ns - start_ns))

    def is_idle(self, cycle: int) -> bool:
        """Whether no manoeuvre is being played, so that the stamps may follow the wall clock again."""
        return self.schedule.is_idle(cycle) and not self.trajectories.is_active

    @property
    def histograms(self) -> dict[str, Histogram]:
        """How late each cycle started, and the durations of its phases and of the whole of it, by name."""
        return self._tally.histograms

    @property
    def model_stopped(self) -> bool:
        """Whether the model has asked to stop."""
        return self._model.stopped

    def disarm(self) -> None:
        """Send zero with the motors off; the first thing on the way out."""
        self._commands = self._zero
        self.hardware.disarm()

    def terminate(self) -> None:
        """Run the final equations.

        Raises:
            ModelFailedError: The model's own equations raised.
        """
        try:
            self._model.terminate()
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "in its final equations") from error

    def _exchange(self, commands: Sequence[float] | None, call: str = "exchange") -> Sensors:
        """Send and measure; a lost link is a fault, and nothing was measured. `call` is what the log names it."""
        try:
            sensors = self.hardware.exchange(commands)
        except LinkLostError as error:
            self.arming.answers.append(HardwareAnswer(call, (str(error),)))
            self.arming.fail(str(error))
            # Nothing was measured: values keep what they were, older and invalid. The model goes on with them; the
            # robot is in FAULT and sends zero, and what is published as measured is NaN.
            last, start_ns = self.sensors or Sensors(), self._start_ns
            elapsed_s, self._measured_ns = (start_ns - self._measured_ns) * 1e-9, start_ns
            ages, valid = tuple(age + elapsed_s for age in last.ages), (False,) * len(last.valid)
            return Sensors(last.values, ages, valid, (str(error),), ready=False, off=False)
        self._measured_ns = self._start_ns
        self.events.extend(sensors.events)
        return sensors

    def _publish(self, cycle: int, stamp_ns: int, sensors: Sensors, inbox: Inbox, now_ns: int) -> list[float]:
        """Hand the state to the ROS stage, where anybody subscribes to it; the published signals."""
        published = self._wiring.publish(sensors, self._y)
        self._supervision.receive_heartbeats(inbox.stations, now_ns)
        if not self._stage.wants_reports:
            return published
        modes, echo = self.arming.modes, self._supervision.echo(now_ns)
        drives = "on" if sensors.ready else "off" if sensors.off else "unconfirmed"
        report = Report(  # in the order of the fields, as above
            stamp_ns,
            modes.mode,
            published,
            self._applied,
            [self._model.read(variable) for variable in self._wiring.topics.values()],
            modes.reason,
            cycle,
            drives if self._zero else "none",
            not any(self._commands),
            echo.heartbeat if echo else None,
            now_ns - echo.received_ns if echo else 0,
            tuple(self._set_values),
            now_ns,
            self.trajectories.status,
            self.trajectories.refused,
        )
        self._stage.publish(report)
        return published

    def _decide(self, cycle: int, inbox: Inbox, sensors: Sensors) -> Setpoint:
        """Take what arrived, then the mode and the set-point of this cycle; `REST` where none is to be followed."""
        arming, schedule, trajectories = self.arming, self.schedule, self.trajectories
        self._receive(cycle, inbox)
        for request in inbox.requests:
            arming.act(request.action, request.answer)
            self._end_trajectory(cycle)  # also where the next request arms again
        if not_finite(self._y) is not None and arming.modes.mode is Mode.DISARMED:
            # The fault was cleared; what is not finite stays so until the model starts anew.
            self._initialize(sensors)
        arming.arm_itself()
        followed = trajectories.due(cycle)
        setpoint = schedule.due(cycle) if followed is None else schedule.follow(followed, cycle)
        silent = schedule.is_silent(cycle) and setpoint != REST
        lost = self._supervision.look(cycle, self._set_values, self.events, has_heartbeat=bool(inbox.stations))
        arming.observe(self._faults(sensors), ready=sensors.ready, setpoints_silent=silent, station_lost=lost)
        self._end_trajectory(cycle, lost=lost)
        setpoint = setpoint if arming.modes.mode is Mode.ARMED else REST
        self._followed = setpoint if arming.is_active else None
        return setpoint

    def _end_trajectory(self, cycle: int, *, lost: bool = False) -> None:
        """End a manoeuvre that is broken off: what is left of it is not the one that was confirmed."""
        modes = self.arming.modes
        is_over = lost or not self.arming.is_active
        if is_over and self.trajectories.abort(f"the robot went to {modes.mode}: {modes.reason}"):
            self.schedule.follow(REST, cycle)

    def _receive(self, cycle: int, inbox: Inbox) -> None:
        """Take the set-points and values that arrived, or refuse them."""
        is_active, schedule, trajectories = self.arming.is_active, self.schedule, self.trajectories
        for trajectory in inbox.trajectories:
            before = trajectories.status
            refusal = trajectories.take(trajectory, cycle, is_armed=is_active)
            if refusal is not None:
                schedule.refuse(refusal)
            elif trajectories.status is not before:  # until it begins the robot rests, whatever it was driven by
                schedule.follow(REST, cycle)
        for setpoint, for_ns in inbox.setpoints:
            if not is_active:
                schedule.refuse(SetpointRefusal.NOT_ARMED)
            elif trajectories.is_active:
                schedule.refuse(SetpointRefusal.FOLLOWS_TRAJECTORY)
            else:
                schedule.add(setpoint, cycle if for_ns is None else self.time_base.cycle_of(for_ns), cycle)
        for place, value in inbox.values:
            if math.isfinite(value):
                self._set_values[place] = value
            else:
                schedule.refuse(SetpointRefusal.NOT_FINITE)

    def _faults(self, sensors: Sensors) -> list[str]:
        too_old: list[str] = []
        if False in sensors.valid:
            too_old = [
                f"{self._signal_names[index]} is too old: {sensors.ages[index] * 1e3:.0f} ms"
                for index in self._monitor.needs
                if not sensors.valid[index]
            ]
        return [*sensors.faults, *too_old, *self._monitor.faults]

    def _pre_arm_checks(self) -> Sequence[PreArmCheck]:
        """The pre-arm checks of the newest snapshot; before the first there is nothing to check but the drives."""
        checks: Sequence[PreArmCheck] = ()
        if self.sensors is not None:
            values, ages, valid = self.sensors.values, self.sensors.ages, self.sensors.valid
            checks = self._monitor.checklist(values, ages, valid, real_time=is_real_time())
        if not self.hardware.commands:  # a robot that is all model has no drives to ask
            return checks
        reasons = self.hardware.arming_failures()
        self.arming.answers.append(HardwareAnswer("obstacles", tuple(reasons)))
        return [drives_check(reasons), *checks]

    def _initialize(self, sensors: Sensors) -> None:
        try:
            self._y = self._model.initialize(self._wiring.model_inputs(sensors, REST, self._set_values))
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "in its initial equations") from error

    def _compute(self, sensors: Sensors, setpoint: Setpoint) -> list[float]:
        u = self._wiring.model_inputs(sensors, setpoint, self._set_values)
        try:
            for state, value in self._wiring.state_writes(setpoint, self._set_values):
                self._model.write(state, value)
            self._y = self._model.step(u)
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "while running") from error
        return u

    def _actuate(self) -> Sequence[float]:
        """Limit the commands, zero unless the robot is active, and send them where they are to leave at once."""
        bad = not_finite(self._y)
        if bad is not None:
            self.arming.fail(f"output '{self._model.outputs[bad].name}' of the model is not finite")
        commands: Sequence[float] = self._zero
        if self.arming.is_active:
            commands = self._limiter.apply(self._wiring.commands(self._y), self._commands)
        self._commands = commands
        if self._immediately:
            # Of its snapshot only the events count, which the next cycle's bears: that one measures anew.
            self._sent_events = self._exchange(commands, "send").events
        return commands


def _model_failed(error: Exception, when: str) -> ModelFailedError:
    where = traceback.extract_tb(error.__traceback__)[-1]
    return ModelFailedError(
        f"the model failed {when}: {type(error).__name__}: {error} ({where.filename}:{where.lineno})"
    )
