"""Lock step over the kernel's own CAN instead of the simulated bus."""

from segway_ecc.firmware_io.links.can_link import make_can_link
from segway_ecc.hil.rig.lockstep import LockstepRig
from segway_ecc.hil.rig.paced_link import PacedLink


def kernel_ends(rig: LockstepRig, channels: tuple[str, str], bitrate: int) -> tuple[PacedLink, PacedLink]:
    """The ends of the bus for robot and plant.

    Args:
        rig: Its clock stands still while a frame is on its way.
        channels: The CAN interfaces of robot and plant: one and the same, or two controllers on one bus.
        bitrate: In bit/s.
    """
    robot, plant = (
        PacedLink(make_can_link("socketcan", channel, bitrate, rig.now_ns, rig.wall_ns)) for channel in channels
    )
    robot.other, plant.other = plant, robot
    return robot, plant
