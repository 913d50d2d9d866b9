# SPDX-License-Identifier: MIT
"""The simulation that a robot file describes, and the rigs that run it: in lock step, or in real time."""

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, Protocol, Self

from segway_ecc.firmware_io.build import can_link, imu_line, make_link, serial_codec
from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.links.serial_writer import SerialWriter
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.devices.family import SimulatedDrives, simulated_drives, simulated_imu
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.no_bus import NoBus
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.wired_plant import WiredPlant
from segway_ecc.node.config import NoHardwareSection, RobotFile
from segway_ecc.node.model.model import Model
from segway_ecc.node.models.load import load_model

Observer = Callable[[int, Sequence[float]], None]
"""Called after each tick of the devices with the wall-clock time, ns, and the plant's outputs."""
Trace = Callable[[int, int, Sequence[float]], None]
"""Called after each tick with the monotonic and the wall-clock time at which it began, ns, and what the motors give."""
_COASTS_NS: Final = 100_000_000
"""The plant runs alone no longer than this: a machine that never catches up has devices all the same."""
WALL_START_NS: Final = 1_700_000_000_000_000_000
"""What the simulated wall clock reads at monotonic time zero."""


def hardware_of(file: RobotFile) -> HardwareSettings:
    """The hardware that is simulated.

    Raises:
        NoSimulationError: The robot has none.
    """
    if isinstance(file.hardware, NoHardwareSection):
        raise NoSimulationError(f"robot '{file.name}' has no hardware that could be simulated: it is all model")
    return file.hardware


def simulated_plant(file: RobotFile) -> Model:
    """The plant that the robot file names.

    Raises:
        NoSimulationError: It names none.
        ModelError: The plant cannot be loaded.
        UnknownNameError: Its wiring names a port that it does not have.
    """
    if file.simulation is None:
        raise NoSimulationError(f"robot '{file.name}' has no plant: add simulation.plant to its file")
    plant, wiring = load_model(file.simulation.plant, file.simulation.parameters), file.simulation.wiring
    return WiredPlant(plant, wiring, file.plant_mixers) if wiring else plant


def simulated_robot(
    file: RobotFile, link: Link, port: Port | None = None, imu_port: Port | None = None
) -> SimulatedRobot:
    """The devices that the robot file describes, with the plant that it names, at the other end of `link` and `port`.

    `imu_port` is the devices' end of an IMU's own serial line.

    Raises:
        NoSimulationError: It names no plant, or drives that are not simulated, or has no hardware, or an IMU at a rate
            that the rig has not.
        PlantMismatchError: The plant does not fit the drives.
        PluginError: Nothing simulates its drives, or its IMU.
    """
    hardware, behind = hardware_of(file), link
    while isinstance(behind, LinkFront):
        behind = behind.behind
    if isinstance(behind, CanLink):
        behind.receives_remote = True  # devices on a real bus are asked by remote frame, as real ones can be
    drives, imu = simulated_drives(hardware), hardware.external_imu
    tick_ns = drives.tick_ns
    devices: list[Device] = [_maker(file, drives)(hardware, link, port)]
    if imu is not None and round(imu.period_s * 1e9) % tick_ns != 0:
        raise NoSimulationError(
            f"the simulated drives tick every {tick_ns * 1e-6:g} ms: make external_imu.period_s, {imu.period_s:g} s, "
            "a multiple of that"
        )
    if imu is not None:
        devices.append(simulated_imu(imu).device(imu, link, imu_port))
    return SimulatedRobot(link, devices, simulated_plant(file), tick_ns)


def _maker(
    file: RobotFile, drives: SimulatedDrives[Any, Any]
) -> Callable[[HardwareSettings, Link, Port | None], Device]:
    """What makes the drives of the release or kind that the robot file names.

    Raises:
        NoSimulationError: The family has none of that name.
    """
    name = None if file.simulation is None else file.simulation.drives
    if name is None:
        return drives.device
    if name not in drives.variants:
        known = ", ".join(drives.variants) or "none: leave it out"
        raise NoSimulationError(f"robot '{file.name}': simulation.drives is {name!r:.80}, simulated are {known}")
    return drives.variants[name]


def devices_link(settings: HardwareSettings, clock: Clock) -> Link:
    """The devices' end, in real time, of the bus that a robot file names; of one that has none, an empty one."""
    line = settings.line
    return can_link(line, clock) if isinstance(line, CanSettings) else NoBus()


def can_of(settings: HardwareSettings) -> CanSettings:
    """The bus that a robot file names; of one that has none, one for the rig that stays empty."""
    line = settings.line
    return line if isinstance(line, CanSettings) else CanSettings()


class RealTimePlant:
    """Ticks a simulated robot at its own rate until it is stopped.

    A tick that comes late is made up for: the laws of physics skip nothing. Those `late` came by more than a whole one.
    Where more are due, the plant alone makes up for them (`SimulatedRobot.coast`), and the devices have the last one. A
    device that measured in the first of them would send, now, where a wheel was then: at 20 rad/s and 27 ms that angle
    is off by half a radian, and a velocity that is right disagrees with it.
    """

    def __init__(self, robot: SimulatedRobot, clock: Clock) -> None:
        """Tick a robot on a clock."""
        self.ticks = 0
        self.late = 0
        self.robot = robot
        self._clock = clock
        self._stopped = False

    def stop(self, _reason: str = "") -> None:
        """End after the present tick; may be called from a signal handler."""
        self._stopped = True

    def run(
        self,
        observe: Observer | None,
        trace: Trace | None = None,
        before_tick: Callable[[], None] | None = None,
    ) -> None:
        """Tick until stopped, then close the bus, which is open.

        Args:
            observe: Sees the plant's outputs.
            trace: Sees what the motors give, when they really give it.
            before_tick: Called before each tick; what it changes is in force in that tick.
        """
        deadline_ns, tick_ns, behind = self._clock.now_ns(), self.robot.tick_ns, 0
        try:
            while not self._stopped:
                self._clock.sleep_until_ns(deadline_ns)
                late_ns = self._clock.now_ns() - deadline_ns
                self.late += late_ns > tick_ns
                behind = max(min(late_ns, _COASTS_NS) - 1, 0) // tick_ns if behind == 0 else behind - 1
                if before_tick is not None:
                    before_tick()
                now_ns, wall_ns = self._clock.now_ns(), self._clock.wall_ns()
                if behind:
                    self.robot.coast()
                else:
                    self.robot.tick(now_ns)
                if trace is not None:
                    trace(now_ns, wall_ns, self.robot.inputs)
                if observe is not None:
                    observe(self._clock.wall_ns() - late_ns, self.robot.outputs)
                self.ticks += 1
                deadline_ns += tick_ns
        finally:
            self.robot.link.close()


class Source(Protocol):
    """Something that acts at times of its own."""

    @property
    def next_ns(self) -> int | None:
        """When it is next to act; None while it is not to."""

    def act(self) -> None:
        """Do what is due now."""


class RigEnds(NamedTuple):
    """Where a node and its devices are joined in lock step.

    Attributes:
        node: The node's link.
        devices: The devices' end of the bus; nothing passes there where the robot has a serial line alone.
        wires: That line; None on a bus.
        imu_wires: The serial line of an IMU; None where it has none.
    """

    node: Link
    devices: Link
    wires: SimulatedSerial | None
    imu_wires: SimulatedSerial | None

    @property
    def imu_port(self) -> Port | None:
        """The IMU's end of its serial line."""
        return None if self.imu_wires is None else self.imu_wires.device

    @property
    def port(self) -> Port | None:
        """The devices' end of the serial line."""
        return None if self.wires is None else self.wires.device


class LockstepRig:
    """A clock that, whenever the node waits, lets the devices run up to the moment the node waits for.

    Its time stops wherever a source is to act.
    """

    def __init__(self, bitrate: int, fd_bitrate: int | None = None) -> None:
        """Make a rig with an empty bus at `bitrate` bit/s, and with CAN FD where its data have a bit rate."""
        self.bus = SimulatedBus(bitrate, self.now_ns, fd_bitrate)
        self._robot: SimulatedRobot | None = None
        self._observe: Observer | None = None
        self._sources: list[Source] = []
        self._now_ns = 0
        self._next_tick_ns = 0

    @classmethod
    def of(cls, settings: HardwareSettings) -> Self:
        """A rig for a robot, whose bus is as fast as the robot file has it."""
        can = can_of(settings)
        return cls(can.bitrate, can.fd_bitrate)

    def ends(self, settings: HardwareSettings) -> RigEnds:
        """The line that a robot file names: the bus, or a serial line of its own in place of one."""
        imu = imu_line(settings)
        lines = [
            line for line in (settings.line, None if imu is None else imu.serial) if isinstance(line, PortSettings)
        ]
        wires = {line.port: SimulatedSerial(line.baudrate, self.now_ns) for line in lines}
        node: Link = self.bus.attach("node")
        if wires:
            node = make_link(settings, self, node, lambda line: wires[line.port].host.open(line))
        own = wires.get(settings.line.port) if isinstance(settings.line, PortSettings) else None
        return RigEnds(node, self.bus.attach("plant"), own, None if imu is None else wires[imu.serial.port])

    def guard_end(self, settings: HardwareSettings, ends: RigEnds) -> Link:
        """Where a guard joins that line, beside the node."""
        line = settings.line
        if isinstance(line, CanSettings) or ends.wires is None:
            return self.bus.attach("guard")
        host = ends.wires.host
        return SerialWriter(line, serial_codec(settings), self.now_ns, lambda _: host)

    def attach(self, robot: SimulatedRobot, observe: Observer | None = None) -> None:
        """Let a simulated robot take part; `observe` is called after each of its ticks."""
        self._robot, self._observe = robot, observe

    def add(self, source: Source) -> None:
        """Let a source act."""
        self._sources.append(source)

    def now_ns(self) -> int:
        """Simulated monotonic time."""
        return self._now_ns

    def wall_ns(self) -> int:
        """Simulated wall-clock time."""
        return WALL_START_NS + self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the devices run, and the sources act, up to the deadline."""
        while (
            self._sources
            and (due_ns := min((at for s in self._sources if (at := s.next_ns) is not None), default=deadline_ns))
            < deadline_ns
        ):
            self._run_until(due_ns)
            for source in self._sources:
                if source.next_ns is not None and source.next_ns <= due_ns:
                    source.act()
        self._run_until(deadline_ns)

    def _run_until(self, deadline_ns: int) -> None:
        robot, observe = self._robot, self._observe
        while robot is not None and self._next_tick_ns < deadline_ns:
            self._now_ns = now_ns = self._next_tick_ns
            robot.tick(now_ns)
            if observe is not None:
                observe(WALL_START_NS + now_ns, robot.outputs)
            self._next_tick_ns += robot.tick_ns
        self._now_ns = max(self._now_ns, deadline_ns)
