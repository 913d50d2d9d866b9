"""The CAN interface that the robot's drives are on."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.firmware_io.links.can_interfaces import socketcan_interfaces
from segway_ecc.firmware_io.links.interface_state import InterfaceState
from segway_ecc.firmware_io.links.link import LinkState

_NETWORK: Final = "/sys/class/net"
_IS_UP: Final = 1
"""IFF_UP of linux/if.h."""
_QUEUE: Final = range(8, 65)
"""Frames: two cycles of commands to two drives fit, and what is left over when a cable is cut is soon gone."""
_GOOD_QUEUE: Final = 16
_RESTART_MS: Final = 100


def check_can(machine: System, workload: Workload) -> Iterator[Finding]:
    """The robot's interface; where no robot is named, every one that there is."""
    present = socketcan_interfaces(machine.path(_NETWORK))
    if workload.hardware is None:
        yield from _without_drives(machine, workload, present)
        return
    can = workload.hardware.can
    if not workload.needs_socketcan:
        yield _not_of_the_kernel(can.interface, can.channel)
    elif can.channel in present:
        yield from _interface(machine, can.channel, can.bitrate)
    elif can.channel == "auto" and present:
        yield from _interface(machine, present[0], can.bitrate)
    else:
        yield _missing("can0" if can.channel == "auto" else can.channel, present, can.bitrate)


def set_up(name: str, bitrate: int | None) -> str:
    """The command that sets an interface up."""
    settings = f"txqueuelen {_GOOD_QUEUE} type can bitrate {bitrate or 500_000} restart-ms {_RESTART_MS}"
    return f"sudo ip link set {name} down; sudo ip link set {name} up {settings}"


def _without_drives(machine: System, workload: Workload, present: list[str]) -> Iterator[Finding]:
    if workload.robot is not None:
        yield good("CAN interface", "this robot is all model and needs none")
    elif not present:
        yield warning(
            "CAN interface",
            "there is none",
            "a robot with drives on CAN cannot run here",
            "connect an adapter, and see that its driver is loaded: sudo dmesg | grep -i can",
        )
    for name in present if workload.robot is None else []:
        yield from _interface(machine, name, None)


def _not_of_the_kernel(interface: str, channel: str) -> Finding:
    found = f"{interface} {channel}, which is no interface of the kernel"
    if interface in {"local", "virtual"}:
        effect = "it reaches simulated drives on this machine only"
    else:
        effect = "its bit rate, state and restart are not known here"
    return warning("CAN interface", found, effect, "in the robot file: hardware.can.interface: socketcan")


def _missing(name: str, present: list[str], bitrate: int) -> Finding:
    there = f"there is {', '.join(present)}" if present else "this machine has no CAN interface"
    return bad(
        f"CAN {name}",
        f"not there; {there}",
        "the drives are out of reach",
        f"connect the adapter, then: {set_up(name, bitrate)}; or correct hardware.can.channel in the robot file",
    )


def _interface(machine: System, name: str, bitrate: int | None) -> Iterator[Finding]:
    # /sys tells of every interface; what the kernel says of its controller may be nothing.
    flags = int(machine.read(f"{_NETWORK}/{name}/flags") or "0", 16)
    state = machine.probes.interface(name)
    if not flags & _IS_UP:
        yield bad(f"CAN {name}", "down", "the drives are out of reach", set_up(name, bitrate))
    else:
        yield _state(name, state, bitrate)
    if state.kind == "vcan":
        yield warning(
            f"CAN {name} kind",
            "virtual (vcan)",
            "it reaches simulated drives on this machine only",
            "name the real interface in the robot file: hardware.can.channel: can0",
        )
    else:
        yield _bitrate(name, state, bitrate)
        yield _restart(name, state, bitrate)
        yield _queue(name, machine.read(f"{_NETWORK}/{name}/tx_queue_len"))


def _state(name: str, state: InterfaceState, bitrate: int | None) -> Finding:
    title, text = f"CAN {name}", f"up, {state.state}" if state.state else "up"
    counters = "" if state.tec is None else f", error counters {state.tec} sent and {state.rec} received"
    wiring = f"see to cable, 120 ohm at both ends, bit rates and power of the drives; ip -details link show {name}"
    match state.state:
        case LinkState.BUS_OFF:
            effect = "the controller has left the bus: the drives hear nothing"
            return bad(title, text + counters, effect, f"{wiring}; then: {set_up(name, bitrate)}")
        case LinkState.PASSIVE | LinkState.WARNING:
            effect = "frames are being lost; with a few more the controller leaves the bus"
            return warning(title, text + counters, effect, wiring)
    return good(title, text)


def _bitrate(name: str, state: InterfaceState, wanted: int | None) -> Finding:
    title = f"CAN {name} bit rate"
    if state.bitrate is None:
        return warning(
            title,
            "the driver does not tell",
            "where it is not that of the drives, nothing gets through",
            f"compare it with the drives; to set it: {set_up(name, wanted)}",
        )
    if wanted is not None and state.bitrate != wanted:
        return bad(
            title,
            f"{state.bitrate} bit/s, the robot file says {wanted}",
            "nothing gets through, and the bus of everybody else is disturbed",
            f"{set_up(name, wanted)}; or correct hardware.can.bitrate in the robot file",
        )
    return good(title, f"{state.bitrate} bit/s")


def _restart(name: str, state: InterfaceState, bitrate: int | None) -> Finding:
    title = f"CAN {name} restart"
    if state.restart_ms:
        return good(title, f"{state.restart_ms} ms after bus-off")
    return warning(
        title,
        "never after bus-off" if state.restart_ms == 0 else "the driver does not tell",
        "once bus-off, the bus stays lost until somebody sets the interface up again",
        f"{set_up(name, bitrate)}; for good: RestartSec=100ms in section [CAN] of its file in /etc/systemd/network",
    )


def _queue(name: str, text: str | None) -> Finding:
    title = f"CAN {name} queue"
    length = int(text or "0")
    if length in _QUEUE:
        return good(title, f"{length} frames")
    effect = (
        "a burst of commands does not fit, and frames are refused"
        if length < _QUEUE.start
        else "frames that nobody acknowledged pile up, and go out late when the cable is back"
    )
    return warning(title, f"{length} frames", effect, f"sudo ip link set {name} txqueuelen {_GOOD_QUEUE}")
