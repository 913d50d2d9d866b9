"""One cycle of the robot: exchange, ROS stage, decide, equations, limit."""

import math
import traceback
from collections import deque
from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.best_effort_recorder import BestEffortRecorder
from segway_ecc.node.cycle.clock import Clock
from segway_ecc.node.cycle.interfaces import (
    PHASES,
    CycleRecord,
    HardwareAnswer,
    Inbox,
    Recorder,
    Report,
    Stage,
    StampedSetpoint,
)
from segway_ecc.node.cycle.real_time import is_real_time
from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal, SetpointSchedule
from segway_ecc.node.cycle.supervision import Supervision
from segway_ecc.node.cycle.time_base import TimeBase
from segway_ecc.node.cycle.timing import Histogram, Tally
from segway_ecc.node.cycle.wiring import Wiring
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.model.model import Model
from segway_ecc.node.safety.limiter import CommandLimiter
from segway_ecc.node.safety.limits import not_finite
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.pre_arm import PreArmCheck, drives_check
from segway_ecc.node.safety.settings import NOTHING_WATCHED, SafetySettings, StationSettings

LATENESS: Final = "lateness"
WHOLE: Final = "cycle"
_EVENTS_KEPT: Final = 64
# As CycleRecord(...) does too, but through a function in Python: microseconds, in a loop whose caches are cold.
_made: Final = tuple.__new__


class Cycle:
    """The parts of a robot, run once per period in their fixed order.

    Attributes:
        arming: The arming manager: modes, drives and who asked to arm.
        schedule: The set-points.
        time_base: Which stamp each cycle bears.
        hardware: The drives and sensors.
        sensors: The newest snapshot of the hardware.
        events: What happened to the links and has not been told yet; the oldest is forgotten where nobody tells it.
        recorder: Keeps the cycles, as long as it can.
    """

    def __init__(  # noqa: PLR0913 - the six seams of the robot, each named at the one place that joins them
        self,
        *,
        model: Model,
        hardware: Hardware,
        wiring: Wiring,
        schedule: SetpointSchedule,
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
        self.arming = ArmingManager(hardware, schedule, arm_at_start=arm_at_start, checklist=self._checklist)
        self.schedule = schedule
        self.time_base = time_base
        self.hardware = hardware
        self._tally = Tally((LATENESS, *PHASES, WHOLE))
        self.sensors = Sensors()
        self.events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self._model = model
        self._wiring = wiring
        self._clock = clock
        self._stage = stage
        self.recorder = BestEffortRecorder(recorder, self.events)
        self._immediately = actuate_immediately
        watched, period_ns = safety or NOTHING_WATCHED, time_base.period_ns
        self._monitor = SafetyMonitor(watched, list(hardware.signals), wiring.sensors, period_ns)
        self._restraint = CommandLimiter(hardware.limits, watched.max_command, watched.command_slew, period_ns * 1e-9)
        self._zero = (0.0,) * len(hardware.commands)
        self._commands: Sequence[float] = self._zero
        self._signal_names = list(hardware.signals)
        self._y: list[float] = []
        self._set_values = list(wiring.set_values)
        self._applied: StampedSetpoint | None = None
        self._told: Setpoint | None = None
        self._initial: Sensors | None = None
        self._supervision = Supervision(station, wiring.set_names, self.arming, period_ns)

    def start(self) -> None:
        """Open the hardware and run the initial and static equations."""
        self.hardware.open()
        self._initial = self.hardware.exchange(self._zero)
        self._initialize(self._initial)

    def run(self, cycle: int, lateness_ns: int) -> None:
        """Run cycle number `cycle`, which started `lateness_ns` after its deadline.

        Raises:
            ModelFailedError: The model's own equations raised.
        """
        now_ns = self._clock.now_ns
        start_ns = now_ns()
        self.arming.modes.cycle = cycle
        self.arming.answers = []
        sensors = self._exchange(None if self._immediately else self._commands)
        exchanged_ns = now_ns()
        self.sensors = sensors
        self.events.extend(sensors.events)
        inbox = self._stage.take_inbox()
        published = self._wiring.publish(sensors, self._y)
        stamp_ns = self.time_base.stamp_ns(cycle)
        self._supervision.hear(inbox.stations, exchanged_ns)
        if self._stage.wants_reports:
            self._stage.publish(self._report(cycle, stamp_ns, published, exchanged_ns))
        published_ns = now_ns()
        self._monitor.look(sensors.values, sensors.valid, start_ns, lateness_ns, self._told)
        self._receive_all(inbox, cycle)
        setpoint = self._decide(cycle, inbox, sensors)
        self._applied = StampedSetpoint(setpoint, stamp_ns) if self.schedule.came_into_force(cycle) else None
        decided_ns = now_ns()
        u = self._equations(sensors, setpoint)
        computed_ns = now_ns()
        self._limit()
        limited_ns = now_ns()
        durations_ns = (
            exchanged_ns - start_ns,
            published_ns - exchanged_ns,
            decided_ns - published_ns,
            computed_ns - decided_ns,
            limited_ns - computed_ns,
        )
        self.recorder.write(
            _made(
                CycleRecord,
                (
                    cycle,
                    stamp_ns,
                    self.arming.modes.mode,
                    lateness_ns,
                    sensors,
                    setpoint,
                    u,
                    self._y,
                    self._commands,
                    published,
                    durations_ns,
                    start_ns,
                    inbox,
                    self.arming.answers,
                    self._initial,
                ),
            )
        )
        self._initial = None
        end_ns = now_ns()
        self._tally.note((lateness_ns, *durations_ns, end_ns - limited_ns, end_ns - start_ns))

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

    def _exchange(self, commands: Sequence[float] | None, *, is_first: bool = True) -> Sensors:
        try:
            return self.hardware.exchange(commands)
        except LinkLostError as error:
            self.arming.answers.append(HardwareAnswer("exchange" if is_first else "send", (str(error),)))
            self.arming.fail(str(error))
            count = len(self._signal_names)
            return Sensors((0.0,) * count, (math.inf,) * count, (False,) * count, (str(error),), ready=False, off=False)

    def _receive_all(self, inbox: Inbox, cycle: int) -> None:
        for setpoint, for_ns in inbox.setpoints:
            self._receive(setpoint, cycle if for_ns is None else self.time_base.cycle_of(for_ns), cycle)
        for place, value in inbox.values:
            self._receive_value(place, value)

    def _receive(self, setpoint: Setpoint, for_cycle: int, cycle: int) -> None:
        if self.arming.is_active:
            self.schedule.add(setpoint, for_cycle, cycle)
        else:
            self.schedule.refuse(SetpointRefusal.NOT_ARMED)

    def _receive_value(self, place: int, value: float) -> None:
        if math.isfinite(value):
            self._set_values[place] = value
        else:
            self.schedule.refuse(SetpointRefusal.NOT_FINITE)

    def _report(self, cycle: int, stamp_ns: int, published: Sequence[float], now_ns: int) -> Report:
        modes, echo = self.arming.modes, self._supervision.echo(now_ns)
        return Report(  # in the order of the fields: by their names takes four times as long
            stamp_ns,
            modes.mode,
            published,
            self._applied,
            [self._model.read(variable) for variable in self._wiring.topics.values()],
            modes.reason,
            cycle,
            _drives(self.sensors) if self._zero else "none",
            not any(self._commands),
            echo.heartbeat if echo else None,
            now_ns - echo.heard_ns if echo else 0,
            tuple(self._set_values),
            now_ns,
        )

    def _decide(self, cycle: int, inbox: Inbox, sensors: Sensors) -> Setpoint:
        for request in inbox.requests:
            self.arming.act(request.action, request.answer)
        if not_finite(self._y) is not None and self.arming.modes.mode is Mode.DISARMED:
            # The fault was cleared; what is not finite stays so until the model starts anew.
            self._initialize(sensors)
        self.arming.arm_itself()
        setpoint = self.schedule.due(cycle)
        silent = self.schedule.is_silent(cycle) and setpoint != REST
        lost = self._supervision.look(cycle, self._set_values, self.events, is_heard=bool(inbox.stations))
        self.arming.observe(self._faults(sensors), ready=sensors.ready, setpoints_silent=silent, station_lost=lost)
        setpoint = setpoint if self.arming.modes.mode is Mode.ARMED else REST
        self._told = setpoint if self.arming.is_active else None
        return setpoint

    def _faults(self, sensors: Sensors) -> list[str]:
        too_old: list[str] = []
        if False in sensors.valid:
            too_old = [
                f"{self._signal_names[index]} is too old: {sensors.ages[index] * 1e3:.0f} ms"
                for index in self._monitor.needs
                if not sensors.valid[index]
            ]
        return [*sensors.faults, *too_old, *self._monitor.faults]

    def _checklist(self) -> Sequence[PreArmCheck]:
        """Go through the checklist with the newest snapshot."""
        sensors = self.sensors
        items = self._monitor.checklist(sensors.values, sensors.ages, sensors.valid, real_time=is_real_time())
        if not self.hardware.commands:  # a robot that is all model has no drives to ask
            return items
        reasons = self.hardware.arming_failures()
        self.arming.answers.append(HardwareAnswer("obstacles", tuple(reasons)))
        return [drives_check(reasons), *items]

    def _initialize(self, sensors: Sensors) -> None:
        try:
            self._y = self._model.initialize(self._wiring.model_inputs(sensors, REST, self._set_values))
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "in its initial equations") from error

    def _equations(self, sensors: Sensors, setpoint: Setpoint) -> list[float]:
        u = self._wiring.model_inputs(sensors, setpoint, self._set_values)
        try:
            for state, value in self._wiring.state_writes(setpoint, self._set_values):
                self._model.write(state, value)
            self._y = self._model.step(u)
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "while running") from error
        return u

    def _limit(self) -> None:
        bad = not_finite(self._y)
        if bad is not None:
            self.arming.fail(f"output '{self._model.outputs[bad].name}' of the model is not finite")
        if self.arming.is_active:
            self._commands = self._restraint.apply(self._wiring.commands(self._y), self._commands)
        else:
            self._commands = self._zero
        if self._immediately:
            self._exchange(self._commands, is_first=False)


def _drives(sensors: Sensors) -> str:
    """What the drives do, as the topic `mode` tells it; off is only what each of them says itself."""
    return "on" if sensors.ready else "off" if sensors.off else "unconfirmed"


def _model_failed(error: Exception, when: str) -> ModelFailedError:
    where = traceback.extract_tb(error.__traceback__)[-1]
    return ModelFailedError(
        f"the model failed {when}: {type(error).__name__}: {error} ({where.filename}:{where.lineno})"
    )
