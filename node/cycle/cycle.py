"""One cycle of the robot: exchange, ROS stage, decide, equations, limit."""

import itertools
import traceback
from collections.abc import Sequence
from typing import Final

from firmware_io.errors import ArmingRefusedError, LinkLostError
from firmware_io.hardware import Hardware, Sensors
from node.cycle.clock import Clock
from node.cycle.seams import CycleRecord, Recorder, Report, Request, Stage, StampedSetpoint
from node.cycle.setpoints import REST, Setpoint, SetpointRefusal, SetpointSchedule
from node.cycle.time_base import TimeBase
from node.cycle.timing import Histogram
from node.cycle.wiring import Wiring
from node.errors import ModelFailedError
from node.model.model import Model
from node.safety.limits import limit, not_finite
from node.safety.modes import ACTIVE, Action, Answer, Mode, Modes

PHASES: Final = ("exchange", "ros", "decide", "equations", "limit", "record")
WHOLE: Final = "cycle"


class Cycle:
    """The parts of a robot, run once per period in their fixed order.

    Attributes:
        modes: What the robot is allowed to do, and why.
        schedule: The set-points.
        arming_obstacle: What keeps a robot that arms itself from doing so; None where nothing does.
        histograms: Duration of each phase, by name, and of the whole cycle.
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
    ) -> None:
        """Join the parts; nothing is opened yet."""
        self.modes = Modes()
        self.arming_obstacle: str | None = None
        self.schedule = schedule
        self.time_base = time_base
        self.hardware = hardware
        self.histograms = {name: Histogram() for name in (*PHASES, WHOLE)}
        self._model = model
        self._wiring = wiring
        self._clock = clock
        self._stage = stage
        self._recorder = recorder
        self._arm_pending = arm_at_start
        self._immediately = actuate_immediately
        self._zero = (0.0,) * len(hardware.commands)
        self._commands: Sequence[float] = self._zero
        self._signal_names = list(hardware.signals)
        self._y: list[float] = []
        self._applied: StampedSetpoint | None = None

    def start(self) -> None:
        """Open the hardware and run the initial and static equations."""
        self.hardware.open()
        sensors = self.hardware.exchange(self._zero)
        self._y = self._equations_start(sensors)

    def run(self, cycle: int, lateness_ns: int) -> None:
        """Run cycle number `cycle`, which started `lateness_ns` after its deadline.

        Raises:
            ModelFailedError: The model's own equations raised.
        """
        now_ns = self._clock.now_ns
        marks = [now_ns()]
        sensors = self._exchange()
        marks.append(now_ns())
        inbox = self._stage.take()
        published = self._wiring.publish(sensors, self._y)
        stamp_ns = self.time_base.stamp_ns(cycle)
        self._stage.publish(Report(stamp_ns, self.modes.mode, published, self._applied))
        marks.append(now_ns())
        for setpoint, for_ns in inbox.setpoints:
            self._receive(setpoint, cycle if for_ns is None else self.time_base.cycle_of(for_ns), cycle)
        setpoint = self._decide(cycle, inbox.requests, sensors)
        self._applied = StampedSetpoint(setpoint, stamp_ns) if self.schedule.came_into_force(cycle) else None
        marks.append(now_ns())
        u = self._equations(sensors, setpoint)
        marks.append(now_ns())
        self._limit()
        marks.append(now_ns())
        durations_ns = tuple(end - start for start, end in itertools.pairwise(marks))
        self._recorder.write(
            CycleRecord(
                cycle,
                stamp_ns,
                self.modes.mode,
                lateness_ns,
                sensors,
                setpoint,
                u,
                self._y,
                self._commands,
                published,
                durations_ns,
            )
        )
        end_ns = now_ns()
        for histogram, duration_ns in zip(
            self.histograms.values(), (*durations_ns, end_ns - marks[-1], end_ns - marks[0]), strict=True
        ):
            histogram.add(duration_ns)

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

    def _exchange(self) -> Sensors:
        try:
            return self.hardware.exchange(None if self._immediately else self._commands)
        except LinkLostError as error:
            self.modes.fail(str(error))
            return Sensors(
                (0.0,) * len(self._signal_names),
                (float("inf"),) * len(self._signal_names),
                (False,) * len(self._signal_names),
                (str(error),),
            )

    def _receive(self, setpoint: Setpoint, for_cycle: int, cycle: int) -> None:
        if self.modes.mode in ACTIVE:
            self.schedule.add(setpoint, for_cycle, cycle)
        else:
            self.schedule.refuse(SetpointRefusal.NOT_ARMED)

    def _decide(self, cycle: int, requests: Sequence[Request], sensors: Sensors) -> Setpoint:
        before = self.modes.mode
        for request in requests:
            request.answer(self._act(request.action))
        if self._arm_pending:
            answer = self._act(Action.ARM)
            self._arm_pending = not answer.accepted
            self.arming_obstacle = None if answer.accepted else answer.message
        setpoint = self.schedule.due(cycle)
        silent = self.schedule.is_silent(cycle) and setpoint != REST
        self.modes.observe(self._faults(sensors), setpoints_silent=silent)
        if before in ACTIVE and self.modes.mode not in ACTIVE:
            self.schedule.clear()
            self.hardware.disarm()
        return setpoint if self.modes.mode is Mode.ARMED else REST

    def _act(self, action: Action) -> Answer:
        if action is not Action.ARM or self.modes.mode is not Mode.DISARMED:
            return self.modes.ask(action)
        try:
            self.hardware.arm()
        except ArmingRefusedError as error:
            return self.modes.ask(action, error.reasons)
        return self.modes.ask(action)

    def _faults(self, sensors: Sensors) -> list[str]:
        faults = list(sensors.faults)
        faults += [
            f"{self._signal_names[index]} is too old: {sensors.ages[index] * 1e3:.0f} ms"
            for index in self._wiring.sensors
            if not sensors.valid[index]
        ]
        bad = not_finite(self._y)
        if bad is not None:
            faults.append(f"output '{self._model.outputs[bad].name}' of the model is not finite")
        return faults

    def _equations_start(self, sensors: Sensors) -> list[float]:
        try:
            return self._model.initialize(self._wiring.model_inputs(sensors, REST))
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "in its initial equations") from error

    def _equations(self, sensors: Sensors, setpoint: Setpoint) -> list[float]:
        u = self._wiring.model_inputs(sensors, setpoint)
        try:
            for state, index in self._wiring.states:
                self._model.write(state, setpoint[index])
            self._y = self._model.step(u)
        except Exception as error:  # the model is the user's and may raise anything
            raise _model_failed(error, "while running") from error
        return u

    def _limit(self) -> None:
        if self.modes.mode not in ACTIVE:
            self._commands = self._zero
        elif not_finite(wanted := self._wiring.commands(self._y)) is None:
            self._commands = limit(wanted, self.hardware.limits)
        else:
            self._commands = self._zero
            self.modes.fail("a command is not finite")
            self.hardware.disarm()
        if self._immediately:
            self.hardware.exchange(self._commands)


def _model_failed(error: Exception, when: str) -> ModelFailedError:
    where = traceback.extract_tb(error.__traceback__)[-1]
    return ModelFailedError(
        f"the model failed {when}: {type(error).__name__}: {error} ({where.filename}:{where.lineno})"
    )
