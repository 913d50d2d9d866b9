"""The guard on the robot, in lock step."""

from collections.abc import Iterator

from segway_ecc.firmware_io.build import Clocks, HardwareSettings
from segway_ecc.firmware_io.guard.guard import PASS_NS, Guard, stopper_of
from segway_ecc.firmware_io.guard.watch import Watch
from segway_ecc.hil.rig.lockstep import LockstepRig


class NoHeartbeats:
    """Nobody beats: a node on the other side of a network cannot, and its commands are on the bus. See `Beats`."""

    def open(self) -> None:
        """There is nothing to open."""

    def take_heartbeats(self) -> Iterator[bool]:
        """None has arrived."""
        return iter(())

    def close(self) -> None:
        """There is nothing to close."""


class LockstepGuard:
    """Makes its passes on the rig's clock; see `Source`.

    Attributes:
        watch: What it watches and decides.
        next_ns: When its next pass is.
    """

    def __init__(self, settings: HardwareSettings, rig: LockstepRig) -> None:
        """Guard the drives on the bus of `rig`."""
        self.watch = Watch(stopper_of(settings), rig.now_ns())
        self.next_ns = 0
        ears, voice = rig.bus.attach("guard's ears"), rig.bus.attach("guard's voice")
        clocks = Clocks(rig.now_ns, rig.wall_ns, rig.sleep_until_ns)
        self._guard = Guard(ears, voice, NoHeartbeats(), self.watch, clocks)

    def act(self) -> None:
        """One pass."""
        self._guard.step()
        self.next_ns += PASS_NS
