# SPDX-License-Identifier: MIT
"""A balancing robot in lock step, disturbed by a script: bit-identical every time, faster than real time."""

import contextlib
import dataclasses
import functools
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, cast

from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import (
    CycleRecord,
    Inbox,
    NoRecorder,
    NoStage,
    Request,
    SetValue,
    StampedSetpoint,
    VariableWrite,
)
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.model.model import Model
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.node.safety.posture import Posture


class Truth(NamedTuple):
    """Where the robot really is at a time; s, m, m, rad, m/s, rad/s, rad, rad/s."""

    time: float
    x: float
    y: float
    heading: float
    linear_velocity: float
    angular_velocity: float
    pitch: float
    pitch_rate: float


class DelayedLink(LinkFront):
    """A link whose frames arrive `delay_ns` later, which may be changed while it runs: as much as whole-loop delay.

    See `Link`.
    """

    def __init__(self, link: Link, now_ns: Callable[[], int]) -> None:
        """Stand in front of `link`, on a clock in ns."""
        super().__init__(link)
        self.delay_ns = 0
        self._now_ns = now_ns
        self._waiting: deque[tuple[int, Frame]] = deque()

    def receive(self) -> list[Frame]:
        """What has waited long enough, with a stamp that is as much later: the delay does not show."""
        now_ns = self._now_ns()
        self._waiting.extend((frame.received_ns, frame) for frame in super().receive())
        frames = []
        while self._waiting and self._waiting[0][0] + self.delay_ns <= now_ns:
            received_ns, frame = self._waiting.popleft()
            frames.append(replace(frame, received_ns=received_ns + self.delay_ns))
        return frames


class BiasedModel:
    """A model whose inputs carry biases, as from a sensor that is off, by name; they may be changed while it runs.

    See `Model`.
    """

    def __init__(self, model: Model) -> None:
        """Stand in front of `model`."""
        self.biases: dict[str, float] = {}
        self._model = model
        self._names = [variable.name for variable in model.inputs]

    def __getattr__(self, name: str) -> object:
        """Everything but the steps is the model's own."""
        return getattr(self._model, name)

    def initialize(self, u: Sequence[float]) -> list[float]:
        """See `Model.initialize`."""
        return self._model.initialize(self._biased(u))

    def step(self, u: Sequence[float]) -> list[float]:
        """See `Model.step`."""
        return self._model.step(self._biased(u))

    def _biased(self, u: Sequence[float]) -> list[float]:
        return [value + self.biases.get(name, 0.0) for name, value in zip(self._names, u, strict=True)]


class ScriptedStage(NoStage):
    """A world that follows a script: at which time what is to happen; see `Stage`."""

    def __init__(self, script: Mapping[float, Callable[[], None]], period_ns: int) -> None:
        """Follow a script, its times in s since the first cycle."""
        self.over: str | None = None
        self.setpoint = Setpoint(0.0, 0.0)
        self.values: list[SetValue] = []
        self.writes: list[VariableWrite] = []
        self.requests: list[Request] = []
        self._cycle = 0
        self._events = {round(time * 1e9 / period_ns): event for time, event in script.items()}

    def take_inbox(self) -> Inbox:
        """The set-point, sent anew in each cycle, and the values, variables and requests of the script."""
        event = self._events.get(self._cycle)
        if event is not None:
            event()
        self._cycle += 1
        values, writes, requests = self.values, self.writes, self.requests
        self.values, self.writes, self.requests = [], [], []
        setpoints = [StampedSetpoint(self.setpoint, None)]
        return Inbox(setpoints=setpoints, values=values, writes=writes, requests=requests)


class _PostureRecorder(NoRecorder):
    """Keeps each cycle's phase of the model, and posture and command of the robot.

    The world is over once the robot has fallen, if that is asked for.
    """

    def __init__(
        self, balance: "Balance", place: int, *, until_fallen: bool, keep: Callable[[CycleRecord], None] | None
    ) -> None:
        self._keep = keep
        self._balance, self._place, self._until_fallen = balance, place, until_fallen
        self._posture: Posture | None = None

    def write(self, record: CycleRecord) -> None:
        """Keep those of a cycle."""
        if self._keep is not None:
            self._keep(record)
        balance = self._balance
        balance.phases.append(record.y[self._place])
        if record.posture is not None:
            self._posture = record.posture.posture
        balance.postures.append(self._posture)
        balance.commands.append(record.commands)
        balance.modes.append(record.mode)
        if self._until_fallen and (self._posture is Posture.FALLEN or balance.phases[-1] == Phase.GIVEN_UP):
            balance.world.over = "the robot fell"


class Balance:
    """One robot with its plant, to be run once.

    Attributes:
        plant: The plant; its disturbances are states.
        world: Who sets set-points.
        model: Its model, whose inputs can be biased.
        link: Its end of the bus.
        truth: Where it really was at each tick.
        phases: The phase of its model in each cycle.
        refusals: Why each write of the script was refused, in order; empty where it was not.
        postures: Its posture in each cycle; None where it has none.
        commands: What was sent in each cycle.
        modes: Its mode in each cycle.
        answers: What came of the requests, the oldest first.
    """

    def __init__(
        self, file: RobotFile, *, pitch: float, seed: int = 1, plant: Mapping[str, float] | None = None
    ) -> None:
        """Put a robot together.

        Args:
            file: The robot file.
            pitch: How it lies at first, rad.
            seed: Of the sensors' errors.
            plant: Other parameters and states of the plant.
        """
        rig = LockstepRig.of(hardware_of(file))
        ends = rig.ends(hardware_of(file))
        self._end = ends.devices
        simulated = simulated_robot(file, self._end, ends.port, ends.imu_port)
        self.plant = simulated.plant
        values = {"InitialPitch": pitch, "Seed": seed, **(plant or {})}
        states = values.keys() & {variable.name for variable in self.plant.states}
        for name in values.keys() - states:
            self.plant.write(name, values[name])
        simulated.outputs = self.plant.initialize(simulated.inputs)  # anew, with the other parameters
        for name in states:
            self.plant.write(name, values[name])
        places = [simulated.output_names.index(f"truth.{name}") for name in Truth._fields[1:]]
        self.truth: list[Truth] = []

        def observe(_wall_ns: int, outputs: Sequence[float]) -> None:
            self.truth.append(Truth(rig.now_ns() * 1e-9, *(outputs[place] for place in places)))

        rig.attach(simulated, observe)
        self.link = DelayedLink(ends.node, rig.now_ns)
        robot = build_robot(file, rig, self.link)
        self.model = BiasedModel(robot.model)
        self.robot = dataclasses.replace(robot, model=cast("Model", self.model))
        self.phases: list[float] = []
        self.refusals: list[str] = []
        self.postures: list[Posture | None] = []
        self.commands: list[Sequence[float]] = []
        self.modes: list[Mode] = []
        self.answers: list[Answer] = []
        self._end.open()

    def run(
        self,
        duration: float,
        script: "Mapping[float, Callable[[Balance], None]] | None" = None,
        *,
        until_fallen: bool = False,
        sits_down_first: bool = False,
        keep: Callable[[CycleRecord], None] | None = None,
    ) -> list[Truth]:
        """Run for some seconds, in which the script happens, or until it falls; return where it really was.

        With `sits_down_first` it ends as `segway-ecc run` does. `keep` is given every cycle, to record it.
        """
        period_ns = self.robot.period_ns
        events = {time: functools.partial(event, self) for time, event in (script or {}).items()}
        self.world = ScriptedStage(events, period_ns)
        place = [v.name for v in self.robot.model.outputs].index("Phase")
        recorder = _PostureRecorder(self, place, until_fallen=until_fallen, keep=keep)
        self.loop: Loop = self.robot.loop(self.world, recorder)
        self.loop.sits_down_first = sits_down_first
        with contextlib.closing(self._end):
            self.loop.run(round(duration * 1e9 / period_ns))
        return self.truth

    def drive(self, linear: float, angular: float) -> None:
        """Set the set-points, m/s and rad/s."""
        self.world.setpoint = Setpoint(linear, angular)

    def ask(self, action: Action) -> None:
        """Request something as an operator does."""
        self.world.requests.append(Request(action, self.answers.append))

    def stand(self, value: float) -> None:
        """Set the value by which it stands (1) or sits (0)."""
        self.world.values.append(SetValue(self.robot.wiring.set_names.index("stand"), value))

    def write(self, **values: float) -> None:
        """Write variables of the controller by name, together or not at all; see `refusals`."""
        self.world.writes.append(VariableWrite(tuple(values.items()), self.refusals.append))
