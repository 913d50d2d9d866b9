# SPDX-License-Identifier: MIT
"""One cycle of the robot: exchange, ROS stage, decide, equations, limit."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.guarded_model import GuardedModel
from segway_ecc.node.cycle.interfaces import (
    MODEL_CALL,
    PHASES,
    UNSEEN_CALL,
    CycleRecord,
    HardwareAnswer,
    Inbox,
    NoRecorder,
    PostureChange,
    Recorder,
    Report,
    Stage,
    StampedSetpoint,
    written_of,
)
from segway_ecc.node.cycle.posture import PostureControl
from segway_ecc.node.cycle.real_time import is_real_time
from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal, SetpointSchedule
from segway_ecc.node.cycle.state import Snapshot, take_snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.supervision import Supervision
from segway_ecc.node.cycle.timing import Histogram, Tally, TimeBase
from segway_ecc.node.cycle.trajectory import TrajectoryFollower
from segway_ecc.node.cycle.wiring import Wiring
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.model.model import Model
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.safety.limiter import CommandLimiter
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.outputs import OutputWatch
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.safety.pre_arm import PreArmCheck, commissioned_check, drives_check, model_check
from segway_ecc.node.safety.residual import ResidualMonitor
from segway_ecc.node.safety.settings import NOTHING_WATCHED, SafetySettings, StationSettings

LATENESS: Final = "lateness"
WHOLE: Final = "cycle"
_EVENTS_KEPT: Final = 64


class _Unrecorded(NoRecorder):
    """Counts the cycles that no recorder is given any more."""

    def __init__(self) -> None:
        self.count = 0
        self.first = 0

    def write(self, record: CycleRecord) -> None:
        """Count it."""
        self.first = self.first if self.count else record.cycle
        self.count += 1


class BestEffortRecorder:
    """Stands in front of a recorder and never raises: recording is worth less than control; see `Recorder`.

    Once the recorder has failed nothing more is given to it, and that is logged once; it is closed all the same.
    Cycles that are not in the log for that are counted, and logged at the end.
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
            self._recorder.write(record)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep a set of diagnostics, while that can be done."""
        self._attempt(lambda: self._recorder.write_diagnostics(stamp_ns, statuses))

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Keep what later cycles depend on, while that can be done."""
        self._attempt(lambda: self._recorder.write_state(take))

    def close(self) -> None:
        """Finish the log, as far as that can be done."""
        self._attempt(self._opened.close)
        if isinstance(self._recorder, _Unrecorded) and self._recorder.count:
            lost = self._recorder
            self._events.append(f"the log lacks {lost.count} cycles, from cycle {lost.first} on: none was handed over")

    def _attempt(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception as error:  # noqa: BLE001 - as above
            self._do_without(error)

    def _do_without(self, error: Exception) -> None:
        if not isinstance(self._recorder, NoRecorder):
            self._events.append(f"recording has ended: {type(error).__name__}: {error}")
            self._recorder = _Unrecorded()


class Cycle:
    """The parts of a robot, run once per period in their fixed order.

    Attributes:
        trajectories: The whole manoeuvre that is followed, if one is.
        time_base: The stamp of each cycle.
        sensors: The newest snapshot of the hardware; None before the first.
        events: What happened to the links and has not been logged yet; of more than 64 the oldest is discarded.
        recorder: Keeps the cycles, as long as it can.
        writer: Writes variables of the model.
    """

    def __init__(  # noqa: PLR0913 - the interfaces of the robot, each named at the one place that joins them
        self,
        *,
        model: Model,
        writer: VariableWriter,
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
        not_commissioned: str | None = None,
    ) -> None:
        """Join the parts; nothing is opened yet. `not_commissioned` is why the robot may never arm, if it may not.

        Raises:
            ConfigurationError: `safety` asks for a check of a signal that the hardware does not measure.
            UnknownNameError: `station` or the posture sets a value that is not wired, or `safety` limits what the
                model does not give.
        """
        self.arming = ArmingManager(hardware, schedule, arm_at_start=arm_at_start, checklist=self._pre_arm_checks)
        self.schedule = schedule
        self.trajectories = trajectories
        self.time_base = time_base
        self.hardware = hardware
        self.writer = writer
        self.sensors: Sensors | None = None
        self.events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self.recorder = BestEffortRecorder(recorder, self.events)
        self._tally = Tally((LATENESS, *PHASES, WHOLE))
        self._model = GuardedModel(model)
        self._wiring = wiring
        self._clock = clock
        self._stage = stage
        self._immediately = actuate_immediately
        watched, period_ns = safety or NOTHING_WATCHED, time_base.period_ns
        self._signal_names = list(hardware.signals)
        commands = list(hardware.commands)
        names, used = self._signal_names, wiring.sensors
        self._monitor = SafetyMonitor(watched, names, used, period_ns, commands, wiring.wheels)
        self._outputs = OutputWatch(watched, wiring.given, commands, len(model.outputs))
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
        self._reported: Report | None = None
        self._supervision = Supervision(station, wiring.set_names, self.arming, period_ns)
        self._posture: PostureControl | None = None
        if watched.posture is not None:
            set_names, period_s = wiring.set_names, period_ns * 1e-9
            self._posture = PostureControl(watched.posture, set_names, self._monitor, self.arming, period_s)
        self._recorded_posture: Posture | None = None
        self._warning: str | None = None
        self._sits_down_first = False
        self._was_live = self._was_misled = False
        self._not_commissioned = not_commissioned

    def start(self) -> None:
        """Open the hardware and run the initial and static equations under what it measures first.

        Raises:
            ModelFailedError: The model failed; see `run`.
        """
        self.hardware.open()
        self._measured_ns = self._clock.now_ns()
        self._initial = self.sensors = self.hardware.exchange(self._zero)
        self.events.extend(self._initial.events)
        try:
            self._initialize(self._initial)
        except ModelFailedError as error:
            self._fail(error, 0, 0, self._initial, self._stage.take_inbox())
            raise

    def run(self, cycle: int, lateness_ns: int) -> None:
        """Run cycle number `cycle`, which started `lateness_ns` after its deadline.

        Raises:
            ModelFailedError: The model failed. The robot is in FAULT with the drives off, which is recorded and
                reported; no cycle can follow.
        """
        now_ns, arming = self._clock.now_ns, self.arming
        start_ns = self._start_ns = now_ns()
        stamp_ns = self.time_base.stamp_ns(cycle)
        arming.modes.cycle, arming.answers, self._model.cycle = cycle, [], cycle
        sensors = self._exchange(None if self._immediately else self._commands)
        if self._sent_events:
            sensors = replace(sensors, events=(*self._sent_events, *sensors.events))
            self._sent_events = ()
        self.sensors = sensors
        exchanged_ns = now_ns()
        inbox = self._stage.take_inbox()
        if self._sits_down_first and self._posture is not None:
            inbox = self._posture.sit_down_first(inbox)
        try:
            if inbox.writes:
                self._write(inbox, sensors)
            published = self._publish(cycle, stamp_ns, sensors, inbox, exchanged_ns)
            published_ns = now_ns()
            self._watch(sensors, start_ns, lateness_ns)
            setpoint = self._decide(cycle, inbox, sensors)
            self._applied = StampedSetpoint(setpoint, stamp_ns) if self.schedule.came_into_force(cycle) else None
            decided_ns = now_ns()
            u = self._compute(sensors, setpoint)
        except ModelFailedError as error:
            self._fail(error, cycle, lateness_ns, sensors, inbox)
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
            inbox, answers, initial, self._posture_change(), self._warning,
        )  # fmt: skip
        self.recorder.write(record)
        self._initial = None
        end_ns = now_ns()
        self._tally.note((lateness_ns, *durations_ns, end_ns - actuated_ns, end_ns - start_ns))

    def take_state(self, cycle: int) -> Snapshot:
        """What cycle number `cycle`, which comes next, and all later ones depend on."""
        return take_snapshot(self, self._model.model, cycle, self.time_base.stamp_ns(cycle))

    @property
    def posture(self) -> Posture | None:
        """What the robot is doing; None where it has no posture."""
        return None if self._posture is None else self._posture.watch.posture

    @property
    def residual(self) -> ResidualMonitor | None:
        """What compares the robot's acceleration with what was designed; None where nothing does."""
        return self._monitor.residual

    def sit_down_first(self) -> bool:
        """Have the robot sit down before it ends; False where it has, or need not."""
        self._sits_down_first = self._posture is not None and self._posture.is_up
        return self._sits_down_first

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
        """Run the final equations, where the initial ones were begun.

        Raises:
            ModelFailedError: The model failed in them, and nowhere before.
        """
        failure = self._model.failure
        try:
            self._model.terminate()
        except ModelFailedError as error:
            if not failure:
                self.arming.modes.fail(str(error))
                raise
            self.events.append(str(error))  # what it failed with first is what ends the run

    def _write(self, inbox: Inbox, sensors: Sensors) -> None:
        """Write variables of the model, each set of them whole or not at all."""
        u = self._wiring.model_inputs(sensors, self._followed or REST, self._set_values)
        is_armed, is_sound = self.arming.is_live, self._model.bad_output is None
        writes, inbox.writes = inbox.writes, []
        for values, answer in writes:
            write = partial(self.writer.write, values, u, is_armed=is_armed, is_sound=is_sound)
            try:
                refusal = self._model.change(write)
            except ModelFailedError as error:
                inbox.written += written_of(values, str(error))
                raise
            inbox.written += written_of(values, refusal)
            answer(refusal)

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
        refused = self.trajectories.refused
        if not self._stage.wants_reports:
            refused.clear()  # a later reader is not to take it for the answer to its own
            return published
        modes, echo = self.arming.modes, self._supervision.echo(now_ns)
        residual = self._monitor.residual
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
            refused.popleft() if refused else None,
            echo is not None and self._supervision.is_introduced(echo.heartbeat.station),
            self.posture,
            () if residual is None else residual.values,
        )
        self._reported = report
        self._stage.publish(report)
        return published

    def _watch(self, sensors: Sensors, start_ns: int, lateness_ns: int) -> None:
        """Have safety look at what was measured; what it warns of is an event, and no reason for anything else."""
        balances = self._posture is not None and self._posture.watch.posture is Posture.BALANCING
        followed, sent = self._followed, self._commands
        self._monitor.look(sensors.values, sensors.valid, start_ns, lateness_ns, followed, sent, balances=balances)
        residual = self._monitor.residual
        self._warning = None if residual is None else residual.warning
        if self._warning is not None:
            self.events.append(self._warning)

    def _decide(self, cycle: int, inbox: Inbox, sensors: Sensors) -> Setpoint:
        """Take what arrived, then the mode and the set-point of this cycle; `REST` where none is to be followed."""
        arming, schedule, trajectories = self.arming, self.schedule, self.trajectories
        self._receive(cycle, inbox)
        posture, set_values = self._posture, self._set_values
        for request in inbox.requests:
            if posture is None:
                arming.act(request.action, request.answer)
            else:
                posture.act(request, set_values)
            self._end_trajectory(cycle)  # also where the next request arms again
        is_absurd = self._outputs.fault is not None or self._model.bad_output is not None
        # What the model made of an IMU that woke up with noise. Once the robot was armed, its odometry is worth more.
        was_misled, self._was_misled = self._was_misled, not self._monitor.imu_is_credible
        self._was_live = self._was_live or arming.is_live
        is_misled = was_misled and not self._was_misled and not self._was_live
        if (is_absurd or is_misled) and arming.modes.mode is Mode.DISARMED:
            # The fault was cleared; what no robot can do may stay so until the model starts anew.
            self._initialize(sensors)
        arming.arm_itself()
        followed = trajectories.due(cycle)
        setpoint = schedule.due(cycle) if followed is None else schedule.follow(followed, cycle)
        silent = schedule.is_silent(cycle) and setpoint != REST
        lost = self._supervision.look(cycle, set_values, self.events, inbox)
        faults = self._faults(sensors)
        if posture is not None:
            faults.extend(posture.look(set_values))
        arming.observe(faults, ready=sensors.ready, setpoints_silent=silent, station_lost=lost)
        if posture is not None:
            posture.settle(set_values)
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
            self._set_value(place, value)

    def _set_value(self, place: int, value: float) -> None:
        """Set a value that anybody may set, or refuse it."""
        low, high = self._wiring.set_ranges[place]
        why = None if self._posture is None else self._posture.refusal(place, value)
        if not math.isfinite(value):
            self.schedule.refuse(SetpointRefusal.NOT_FINITE)
        elif not low <= value <= high:
            self.schedule.refuse(SetpointRefusal.OUT_OF_RANGE)
        elif why is not None:
            self.schedule.refuse(SetpointRefusal.NOT_ARMED)
            if why:
                self.events.append(why)
        elif self._refuses(place, value):
            self.schedule.refuse(SetpointRefusal.REFUSED_BY_MODEL)
        else:
            self._set_values[place] = value

    def _refuses(self, place: int, value: float) -> bool:
        """Whether a state that a value is wired to does not take it; all of them are left with the old one then."""
        writes = self._wiring.writes_of(place, value)
        before = self._wiring.writes_of(place, self._set_values[place])
        return any(self._model.refuses(state, new, old) for (state, new), (_, old) in zip(writes, before, strict=True))

    def _faults(self, sensors: Sensors) -> list[str]:
        """What is wrong. What was never measured is awaited until the drives are ready: some measure only then."""
        too_old: list[str] = []
        if False in sensors.valid:
            too_old = [
                f"{self._signal_names[index]} is too old: {sensors.ages[index] * 1e3:.0f} ms"
                for index in self._monitor.needs
                if not sensors.valid[index] and (sensors.ready or sensors.ages[index] != math.inf)
            ]
        outputs = () if self._outputs.fault is None else (self._outputs.fault,)
        return [*sensors.faults, *too_old, *self._monitor.faults, *outputs]

    def _pre_arm_checks(self) -> Sequence[PreArmCheck]:
        """The pre-arm checks of the newest snapshot; before the first there is nothing to check but the drives."""
        checks: Sequence[PreArmCheck] = ()
        if self.sensors is not None:
            values, ages, valid = self.sensors.values, self.sensors.ages, self.sensors.valid
            unseen = self.sensors.unseen
            checks = self._monitor.checklist(values, ages, valid, real_time=is_real_time(), unseen=unseen)
            if unseen:  # no number shows it, and a replay needs it
                self.arming.answers.append(HardwareAnswer(UNSEEN_CALL, unseen))
        if self._outputs.fault is not None:
            checks = [*checks, model_check(self._outputs.fault)]
        lacking = () if self._not_commissioned is None else (self._not_commissioned,)
        checks = [*checks, *map(commissioned_check, lacking)]
        if not self.hardware.commands:  # a robot that is all model has no drives to ask
            return checks
        reasons = self.hardware.arming_failures()
        # A replay has no report to read: what the run was refused for is in its log beside the drives' reasons.
        self.arming.answers.append(HardwareAnswer("obstacles", (*reasons, *lacking)))
        return [drives_check(reasons), *checks]

    def _initialize(self, sensors: Sensors) -> None:
        self._outputs.restart()
        self._y = self._model.initialize(self._wiring.model_inputs(sensors, REST, self._set_values))

    def _posture_change(self) -> PostureChange | None:
        """The posture that was entered in this cycle, to be recorded."""
        if self._posture is None or self._posture.watch.posture is self._recorded_posture:
            return None
        watch = self._posture.watch
        self._recorded_posture = watch.posture
        return PostureChange(watch.posture, watch.reason)

    def _compute(self, sensors: Sensors, setpoint: Setpoint) -> list[float]:
        set_values: Sequence[float] = self._set_values
        if self._posture is not None:
            set_values = self._posture.model_values(set_values)
        u = self._wiring.model_inputs(sensors, setpoint, set_values)
        for state, value in self._wiring.state_writes(setpoint, set_values):
            self._model.write(state, value)
        self._y = self._model.step(u)
        return u

    def _fail(self, error: ModelFailedError, cycle: int, lateness_ns: int, sensors: Sensors, inbox: Inbox) -> None:
        """Enter FAULT for a model that failed, and record and report it: no cycle follows that would."""
        arming, reason, y = self.arming, str(error), self._y or [math.nan] * len(self._model.model.outputs)
        arming.fail(reason)
        self._commands = self._zero
        self._end_trajectory(cycle)
        inbox.writes = []  # what was not carried out is not recorded
        if self._posture is not None:
            self._posture.settle(self._set_values)
        # What led to it is in the log, so that a replay fails in the same cycle.
        arming.answers.append(HardwareAnswer(MODEL_CALL, (reason,)))
        u = self._model.u or (math.nan,) * len(self._wiring.inputs)
        record = CycleRecord(
            cycle, self.time_base.stamp_ns(cycle), arming.modes.mode, lateness_ns, sensors, REST, u, y, self._zero,
            self._wiring.publish(sensors, y), (0,) * (len(PHASES) - 1), self._start_ns, inbox, arming.answers,
            self._initial, self._posture_change(), self._warning,
        )  # fmt: skip
        self.recorder.write(record)
        if self._reported is not None and self._stage.wants_reports:
            report = replace(  # as of the next cycle, since the state of this one was published
                self._reported,
                stamp_ns=self.time_base.stamp_ns(cycle + 1),
                cycle=cycle + 1,
                mode=arming.modes.mode,
                reason=reason,
                applied=None,
                drives="unconfirmed" if self._zero else "none",
                is_zero=True,
                at_ns=self._clock.now_ns(),
                trajectory=self.trajectories.status,
                refused_trajectory=None,
                posture=self.posture,
            )
            self._stage.publish(report)

    def _actuate(self) -> Sequence[float]:
        """Limit the commands, zero unless the robot is active, and send them where they are to leave at once."""
        is_active, bad = self.arming.is_active, self._model.bad_output
        reaches_motors = is_active and (self._posture is None or self._posture.gives_torque)
        if bad is not None:
            self.arming.fail(f"output '{self._model.model.outputs[bad].name}' of the model is not finite")
        else:
            given = self._wiring.with_sums(self._y)
            fault = self._outputs.look(given, self._monitor.elapsed_s, is_active=reaches_motors)
            if fault is not None and is_active:
                self.arming.fail(fault)
        commands: Sequence[float] = self._zero
        if reaches_motors and self.arming.is_active:
            commands = self._limiter.apply(self._wiring.commands(self._y), self._commands)
        self._commands = commands
        if self._immediately:
            # Of its snapshot only the events count, which the next cycle's bears: that one measures anew.
            self._sent_events = self._exchange(commands, "send").events
        return commands
