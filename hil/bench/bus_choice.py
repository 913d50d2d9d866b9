"""On which bus the programs are compared."""

import os

from segway_ecc.firmware_io.links.can_interfaces import socketcan_interfaces
from segway_ecc.firmware_io.links.interface_state import read_interface_state
from segway_ecc.hil.bench.rig import Bus


def virtual_interface() -> str | None:
    """The first virtual CAN interface of this machine that is up."""
    states = {name: read_interface_state(name) for name in socketcan_interfaces()}
    return next((name for name, state in states.items() if state.kind == "vcan" and state.is_up), None)


def choose_bus(channel: str | None, plant_channel: str | None) -> Bus:
    """The bus of the comparison.

    A real interface is used only where it is named: what is sent there would reach motors.

    Args:
        channel: A CAN interface of the kernel; None for a virtual one that is up, and else for a local bus.
        plant_channel: The plant's, where that is another controller on the same bus.
    """
    if channel is not None:
        return Bus("socketcan", channel, plant_channel or channel)
    name = virtual_interface()
    if name is not None:
        return Bus("socketcan", name, name)
    name = f"bench_{os.getpid()}"
    return Bus("local", name, name)
