# SPDX-License-Identifier: MIT
"""The drivers of a family and its simulated drives on one bus in lock step, each motor with a rotor of its own."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.firmware_io.drives.family import DriveFamily
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.devices.family import SimulatedDrives
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFront
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel

PERIOD_S: Final = 0.01
"""Of the loop that drives are tried in."""
_LAG_S: Final = 0.1
_FULL_SPEED: Final = 10.0
"""Of a rotor at the largest command, rad/s."""


class NonconformanceError(AssertionError):
    """A drive family or its simulated drives do not keep what the software relies on; the text says what was found."""


class Rotors(SectionedModel):
    """A rotor for each command, whose velocity follows the command with a lag; see `rotors`."""

    name = "rotors"
    step_size = 0.001
    gains: Sequence[float] = ()

    def input(self, u: Sequence[float]) -> None:
        """Take what the motors give."""
        self.given = tuple(u)

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Rates of angle and velocity of each rotor."""
        velocities = s[1::2]
        motors = zip(self.gains, self.given, velocities, strict=True)
        rates = [(gain * command - velocity) / _LAG_S for gain, command, velocity in motors]
        return [rate for pair in zip(velocities, rates, strict=True) for rate in pair]

    def output(self) -> Sequence[float]:
        """Angle and velocity of each rotor; rad, rad/s."""
        return tuple(self.s)


def rotors(limits: Mapping[str, float]) -> Rotors:
    """A rotor for each command, which turns at full speed at its limit."""
    moving = tuple(
        Variable(f"{command.rpartition('.')[0]}.{name}", unit)
        for command in limits
        for name, unit in (("angle", "rad"), ("velocity", "rad/s"))
    )
    filled = {
        "inputs": tuple(Variable(command, "1") for command in limits),
        "states": moving,
        "outputs": moving,
        "gains": [_FULL_SPEED / limit for limit in limits.values()],
    }
    made: type[Rotors] = type("Rotors", (Rotors,), filled)
    return made()


class TappedLink(LinkFront):
    """Keeps what passes on a link either way; see `Link`."""

    def __init__(self, behind: Link) -> None:
        """Tap `behind`."""
        super().__init__(behind)
        self._seen: list[Frame] = []

    def send(self, frame: Frame) -> bool:
        """Send, and keep."""
        self._seen.append(frame)
        return self.behind.send(frame)

    def receive(self) -> list[Frame]:
        """Receive, and keep."""
        frames = self.behind.receive()
        self._seen += frames
        return frames

    def take_seen(self) -> list[Frame]:
        """What has passed since the last time."""
        seen, self._seen = self._seen, []
        return seen


class DriveRig:
    """Drives under test; see `DriveFamily` and `SimulatedDrives`.

    Attributes:
        hardware: The drivers, joined to the robot's hardware.
        robot: The simulated drives with their rotors.
        link: The drivers' end of the bus, which faults can be set on.
        sensors: What was measured last.
        seen: All frames on the bus, with the time of each.
    """

    def __init__(
        self, family: DriveFamily[Any], simulated: SimulatedDrives[Any, Any], settings: HardwareSettings
    ) -> None:
        """Join them, and open the bus."""
        self.rig = LockstepRig.of(settings)
        self._settings = settings
        self._ends = ends = self.rig.ends(settings)
        self._on_line = TappedLink(ends.node)
        self.link = FaultyLink(self._on_line)
        self.drives = family.drives(settings, self.link, PERIOD_S, self.rig)
        self.hardware = Assembly(self.link, self.drives, (), self.rig.now_ns)
        end = ends.devices
        device = simulated.device(settings, end, ends.port)
        limits = dict(zip(self.hardware.commands, self.hardware.limits, strict=True))
        missing = [name for name in device.inputs if name not in limits]
        if missing:
            raise NonconformanceError(f"nothing commands {', '.join(missing)}, which the simulated drives give")
        plant = rotors({name: limits[name] for name in device.inputs})
        self.robot = SimulatedRobot(end, [device], plant, simulated.tick_ns)
        self.rig.attach(self.robot)
        self._listener = self.rig.bus.attach("listener")
        self._stranger = self.rig.bus.attach("stranger")
        self.seen: list[Frame] = []
        end.open()
        self.hardware.open()
        self.sensors = Sensors()
        self.zero: Sequence[float] = (0.0,) * len(self.hardware.commands)

    @property
    def now_s(self) -> float:
        """Simulated time, s."""
        return self.rig.now_ns() / NS_PER_S

    @property
    def motors(self) -> dict[str, float]:
        """What each motor gives, by the name of its command."""
        return dict(zip([v.name for v in self.robot.plant.inputs], self.robot.inputs, strict=True))

    @property
    def rotors(self) -> dict[str, float]:
        """The angle and the velocity of each rotor."""
        return dict(zip(self.robot.output_names, self.robot.outputs, strict=True))

    @property
    def measured(self) -> dict[str, tuple[float, bool]]:
        """Each signal's newest value, and whether it is valid."""
        return dict(zip(self.hardware.signals, zip(self.sensors.values, self.sensors.valid, strict=True), strict=True))

    def wait(self, seconds: float) -> None:
        """Let time pass in which the drivers do nothing."""
        self.rig.sleep_until_ns(self.rig.now_ns() + round(seconds * NS_PER_S))
        self.seen += self._listener.receive() if self._ends.wires is None else self._on_line.take_seen()

    def guard(self) -> Link:
        """The guard's end of the line: on a serial one it writes where the node does."""
        return self.rig.guard_end(self._settings, self._ends)

    def disturb(self, frame: Frame) -> None:
        """Let a stranger send a frame; on a serial line its bytes are noise, without any frame around them."""
        if self._ends.wires is None:
            self._stranger.send(frame)
        else:
            self._ends.wires.host.inject(frame.data)

    def cycle(self, commands: Sequence[float] | None = None) -> Sensors:
        """One cycle with commands, zero by default."""
        self.sensors = self.hardware.exchange(self.zero if commands is None else commands)
        self.wait(PERIOD_S)
        return self.sensors

    def run(self, seconds: float, commands: Sequence[float] | None = None) -> None:
        """So many cycles."""
        for _ in range(round(seconds / PERIOD_S)):
            self.cycle(commands)

    def run_until(self, is_done: Callable[[], bool], within_s: float, otherwise: Callable[[], str]) -> None:
        """Cycles with zero until something is so.

        Raises:
            NonconformanceError: It is not within `within_s`; `otherwise` says what was expected, and what was found.
        """
        for _ in range(round(within_s / PERIOD_S)):
            if is_done():
                return
            self.cycle()
        if not is_done():
            raise NonconformanceError(otherwise())

    def arm(self) -> None:
        """Pass the pre-arm checks, and switch the motors on.

        Raises:
            NonconformanceError: That takes longer than it may.
        """
        hardware = self.hardware
        self.run_until(
            lambda: not hardware.arming_failures(),
            _PASSES_WITHIN_S,
            lambda: (
                f"does not pass its pre-arm checks in {_PASSES_WITHIN_S:g} s: {'; '.join(hardware.arming_failures())}"
            ),
        )
        hardware.arm()
        self.run_until(
            lambda: self.sensors.ready,
            _READY_WITHIN_S,
            lambda: f"is not ready {_READY_WITHIN_S:g} s after arm; faults: {self.sensors.faults or 'none'}",
        )


_PASSES_WITHIN_S: Final = 5.0
_READY_WITHIN_S: Final = 2.0
