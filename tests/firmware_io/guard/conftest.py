# SPDX-License-Identifier: MIT
"""A robot, its simulated drives and its guard on one simulated bus, in lock step."""

import importlib.resources
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.guard.guard import Guard, stopper_of
from segway_ecc.firmware_io.guard.watch import Watch
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import NoHardwareSection, load_robot
from segway_ecc.node.robot import build_robot

MS = 1_000_000


@dataclass
class Beats:
    """Heartbeats without a socket."""

    waiting: list[bool] = field(default_factory=list)
    answered: list[str] = field(default_factory=list)
    is_cut: bool = False
    has_guard: bool = True
    needs_guard: bool = False
    stops: str = ""
    unread: list[str] = field(default_factory=list)

    def beat(self, *, is_on: bool) -> None:
        if self.unread:
            self.stops = max(self.unread)  # a text, where there is any
            self.unread.clear()
        if not self.is_cut:
            self.waiting.append(is_on)

    def open(self) -> None:
        self.waiting.clear()

    def pause(self) -> None:
        pass

    def answer(self, stops: str) -> None:
        self.answered.append(stops)
        self.unread.append(stops)

    def take_heartbeats(self) -> Iterator[bool]:
        while self.waiting:
            yield self.waiting.pop(0)

    def close(self) -> None:
        pass


class Guarded:
    """A robot that is run an exchange at a time, and its guard, which looks after each tick of the drives.

    Attributes:
        moments: For each tick: when, and what the motors gave.
    """

    def __init__(
        self,
        robot: str,
        *,
        period_ms: int = 10,
        wrap: Callable[[Link], Link] | None = None,
        wrap_guard: Callable[[Link], Link] | None = None,
    ) -> None:
        file = load_robot(robot)
        assert not isinstance(file.hardware, NoHardwareSection)
        self.settings: HardwareSettings = file.hardware
        self.rig = LockstepRig.of(hardware_of(file))
        ends = self.rig.ends(hardware_of(file))
        self.plant: SimulatedRobot = simulated_robot(file, ends.devices, ends.port, ends.imu_port)
        node = ends.node
        self.bus = FaultyLink(node if wrap is None else wrap(node))
        built = build_robot(file, self.rig, self.bus).hardware
        assert isinstance(built, Assembly)
        self.robot = built
        self.beats = Beats()
        built._gate._owner = self.beats
        self.moments: list[tuple[int, tuple[float, ...]]] = []
        self.guard_link = self.rig.guard_end(self.settings, ends)
        self.guard_link.open()
        self.guard = self.new_guard(self.guard_link if wrap_guard is None else wrap_guard(self.guard_link))
        self.is_watched = True
        self.rig.attach(self.plant, self._observe)
        self.period_ns = period_ms * MS
        self._next_ns = self.period_ns

    def new_guard(self, link: Link) -> Guard:
        self.watch = Watch(stopper_of(self.settings), self.rig.now_ns())
        return Guard(link, self.beats, self.watch, self.rig)

    def _observe(self, _wall_ns: int, _outputs: object) -> None:
        self.moments.append((self.rig.now_ns(), tuple(self.plant.inputs)))
        if self.is_watched:
            self.guard.step()

    def cycle(self, commands: tuple[float, float] = (1.0, 1.0)) -> Sensors:
        """Wait for the next deadline and exchange."""
        self.rig.sleep_until_ns(self._next_ns)
        self._next_ns = max(self._next_ns, self.rig.now_ns()) + self.period_ns
        return self.robot.exchange(commands)

    def arm(self) -> None:
        """Have the drives prove what they must, and switch them on."""
        self.robot.open()
        self._next_ns = self.rig.now_ns() + self.period_ns
        while self._arming_failures():
            self.cycle((0.0, 0.0))
            assert self.rig.now_ns() < 20_000 * MS, self._arming_failures()
        self.robot.arm()
        while not self.cycle((0.0, 0.0)).ready:
            assert self.rig.now_ns() < 20_000 * MS

    def _arming_failures(self) -> list[str]:
        return [reason for device in self.robot._devices for reason in device.arming_failures()]

    def drive(self, cycles: int) -> None:
        for _ in range(cycles):
            self.cycle()

    def kill(self) -> None:
        """The node is gone: nothing of it arrives from now on."""
        self.bus.fault = LinkFault.CUT
        self.beats.is_cut = True

    def wait(self, ms: float) -> None:
        """Time passes without the node."""
        self.rig.sleep_until_ns(self.rig.now_ns() + round(ms * MS))

    @property
    def gives_torque(self) -> bool:
        return any(abs(value) > 1e-3 for value in self.plant.inputs)


@pytest.fixture
def guarded() -> type[Guarded]:
    return Guarded


@pytest.fixture
def cart_of(tmp_path: Path) -> Callable[[int], str]:
    """Makes the file of a cart behind a wheel board of a version of the protocol."""

    def made(protocol: int) -> str:
        text = importlib.resources.files("segway_ecc.node").joinpath("robots/cart-can.yaml").read_text("utf-8")
        path = tmp_path / f"cart-{protocol}.yaml"
        path.write_text(text.replace("type: wheel_board\n", f"type: wheel_board\n  protocol: {protocol}\n"), "utf-8")
        return str(path)

    return made
