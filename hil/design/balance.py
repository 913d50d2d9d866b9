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
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoRecorder, NoStage, SetValue, StampedSetpoint
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.model.model import Model
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.robot import build_robot


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
    """A link whose frames arrive later, which is as much as whole-loop delay; see `Link`.

    Attributes:
        delay_ns: How much later what is received arrives, ns; may be changed while it runs.
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
    """A model whose inputs carry a bias, as from a sensor that is off; see `Model`.

    Attributes:
        biases: What is added to inputs, by name; may be changed while it runs.
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
        self._cycle = 0
        self._events = {round(time * 1e9 / period_ns): event for time, event in script.items()}

    def take_inbox(self) -> Inbox:
        """The set-point, sent anew in each cycle, and the values that the script set."""
        event = self._events.get(self._cycle)
        if event is not None:
            event()
        self._cycle += 1
        values, self.values = self.values, []
        return Inbox(setpoints=[StampedSetpoint(self.setpoint, None)], values=values)


class _PhaseRecorder(NoRecorder):
    """Keeps the phase of each cycle; the world is over once the robot has given up, if that is asked for."""

    def __init__(self, place: int, kept: list[float], world: ScriptedStage | None) -> None:
        self._place, self._kept, self._world = place, kept, world

    def write(self, record: CycleRecord) -> None:
        """Keep the phase of a cycle."""
        self._kept.append(record.y[self._place])
        if self._world is not None and self._kept[-1] == Phase.GIVEN_UP:
            self._world.over = "the robot gave up"


class Balance:
    """One robot with its plant, to be run once.

    Attributes:
        plant: The plant; its disturbances are states.
        world: Who sets set-points.
        model: Its model, whose inputs can be biased.
        link: Its end of the bus.
        truth: Where it really was at each tick.
        phases: The phase of its model in each cycle.
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
        rig = LockstepRig(hardware_of(file).can.bitrate)
        self._end = rig.bus.attach("plant")
        simulated = simulated_robot(file, self._end)
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
        self.link = DelayedLink(rig.bus.attach("node"), rig.now_ns)
        robot = build_robot(file, rig, self.link)
        self.model = BiasedModel(robot.model)
        self.robot = dataclasses.replace(robot, model=cast("Model", self.model))
        self.phases: list[float] = []
        self._end.open()

    def run(
        self,
        duration: float,
        script: "Mapping[float, Callable[[Balance], None]] | None" = None,
        *,
        until_given_up: bool = False,
    ) -> list[Truth]:
        """Run for some seconds, in which the script happens, or until it gives up; return where it really was."""
        period_ns = self.robot.period_ns
        events = {time: functools.partial(event, self) for time, event in (script or {}).items()}
        self.world = ScriptedStage(events, period_ns)
        place = [v.name for v in self.robot.model.outputs].index("Phase")
        recorder = _PhaseRecorder(place, self.phases, self.world if until_given_up else None)
        self.loop: Loop = self.robot.loop(self.world, recorder)
        with contextlib.closing(self._end):
            self.loop.run(round(duration * 1e9 / period_ns))
        return self.truth

    def drive(self, linear: float, angular: float) -> None:
        """Set the set-points, m/s and rad/s."""
        self.world.setpoint = Setpoint(linear, angular)

    def stand(self, value: float) -> None:
        """Request it to stand (1) or to sit (0)."""
        self.world.values.append(SetValue(self.robot.wiring.set_names.index("stand"), value))
