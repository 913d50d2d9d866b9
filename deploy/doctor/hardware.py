# SPDX-License-Identifier: MIT
"""The CAN interface and the serial lines of the robot, and the watchdogs of its drives."""

import errno
import re
from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.check import Finding, System, Workload, bad, good, graded, warning
from segway_ecc.firmware_io.build import imu_line, serial_of
from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.firmware_io.links.can_interfaces import InterfaceState, set_up_options, socketcan_interfaces
from segway_ecc.firmware_io.links.link import LinkState
from segway_ecc.firmware_io.links.serial_link import open_remedy
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings
from segway_ecc.firmware_io.settings import HardwareSettings, SerialOnlySettings

_NETWORK: Final = "/sys/class/net"
_IS_UP: Final = 1
"""IFF_UP of linux/if.h."""
_QUEUE: Final = range(8, 65)
"""Frames: two cycles of commands to two drives fit, and what is left over when a cable is cut is soon gone."""
_GOOD_QUEUE: Final = 16
_RESTART_MS: Final = 100
_SIMULATED: Final = "it reaches simulated drives on this machine only"
_UNKNOWN: Final = "not reported by the driver"
_CYCLES: Final = 3
_LONG_WATCHDOG_S: Final = 0.1
"""A balancing robot whose torque stays as it is for longer than this has fallen."""
_NUMBERED_AS_FOUND: Final = re.compile(r"/dev/tty(USB|ACM)\d+")
_TAKEN: Final = (errno.EAGAIN, errno.EBUSY)


def check_can(machine: System, workload: Workload) -> Iterator[Finding]:
    """The robot's interface; where no robot is named, every one that there is."""
    present = socketcan_interfaces(machine.path(_NETWORK))
    if workload.robot is None:
        for name in present:
            yield from _interface(machine, name, None)
        if not present:
            remedy = "connect an adapter, and see that its driver is loaded: sudo dmesg | grep -i can"
            yield warning("CAN interface", "there is none", "a robot with drives on CAN cannot run here", remedy)
        return
    if workload.hardware is None:
        yield good("CAN interface", "this robot is all model and needs none")
        return
    can = workload.hardware.line
    if not isinstance(can, CanSettings):
        yield good("CAN interface", "this robot's drives are on a serial line alone")
        return
    name = next(iter(present), "can0") if can.channel == "auto" else can.channel
    if not workload.needs_socketcan:
        found = f"{can.interface} {can.channel}, which is no interface of the kernel"
        is_local = can.interface in {"local", "virtual"}
        effect = _SIMULATED if is_local else "its bit rate, state and restart are not known here"
        yield warning("CAN interface", found, effect, "in the robot file: hardware.can.interface: socketcan")
    elif name in present:
        yield from _interface(machine, name, can)
    else:
        there = f"there is {', '.join(present)}" if present else "this machine has no CAN interface"
        command = f"connect the adapter, then: {set_up(name, can)}"
        remedy = f"{command}; or correct hardware.can.channel in the robot file"
        yield bad(f"CAN {name}", f"not there; {there}", "the drives are out of reach", remedy)


def set_up(name: str, can: CanSettings | None) -> str:
    """The command that sets an interface up."""
    can = can or CanSettings()
    settings = (
        f"txqueuelen {_GOOD_QUEUE} type can {set_up_options(can.bitrate, can.fd_bitrate)} restart-ms {_RESTART_MS}"
    )
    return f"sudo ip link set {name} down; sudo ip link set {name} up {settings}"


def _interface(machine: System, name: str, can: CanSettings | None) -> Iterator[Finding]:
    # /sys lists every interface; the kernel may report nothing of its controller.
    flags = int(machine.read(f"{_NETWORK}/{name}/flags") or "0", 16)
    state = machine.probes.interface(name)
    title, text = f"CAN {name}", f"up, {state.state}" if state.state else "up"
    counters = "" if state.tec is None else f", error counters {state.tec} sent and {state.rec} received"
    wiring = f"see to cable, 120 ohm at both ends, bit rates and power of the drives; ip -details link show {name}"
    if not flags & _IS_UP:
        yield bad(title, "down", "the drives are out of reach", set_up(name, can))
    elif state.state is LinkState.BUS_OFF:
        effect = "the controller has left the bus: the drives receive nothing"
        yield bad(title, text + counters, effect, f"{wiring}; then: {set_up(name, can)}")
    elif state.state in {LinkState.PASSIVE, LinkState.WARNING}:
        effect = "frames are being lost; with a few more the controller leaves the bus"
        yield warning(title, text + counters, effect, wiring)
    else:
        yield good(title, text)
    if state.kind != "vcan":
        yield from _controller(title, state, can, set_up(name, can))
        length = int(machine.read(f"{_NETWORK}/{name}/tx_queue_len") or "0")
        effect = (
            "a burst of commands does not fit, and frames are refused"
            if length < _QUEUE.start
            else "frames that nobody acknowledged pile up, and go out late when the cable is back"
        )
        remedy = f"sudo ip link set {name} txqueuelen {_GOOD_QUEUE}"
        yield graded(f"{title} queue", f"{length} frames", effect, remedy, fits=length in _QUEUE)
        return
    remedy = "name the real interface in the robot file: hardware.can.channel: can0"
    yield warning(f"{title} kind", "virtual (vcan)", _SIMULATED, remedy)


def _controller(title: str, state: InterfaceState, can: CanSettings | None, command: str) -> Iterator[Finding]:
    """Bit rates and restart; `command` sets the interface up."""
    wanted = None if can is None else can.bitrate
    yield _bit_rate(f"{title} bit rate", state.bitrate, wanted, ("bitrate", command))
    if can is not None and can.fd_bitrate is not None:
        name = f"{title} data bit rate"
        if state.bitrate is not None and state.data_bitrate is None:
            yield bad(name, "none: it carries classic frames only", "drives on CAN FD are out of reach", command)
        else:
            yield _bit_rate(name, state.data_bitrate, can.fd_bitrate, ("data_bitrate", command))
    never = "never after bus-off" if state.restart_ms == 0 else _UNKNOWN
    yield graded(
        f"{title} restart",
        f"{state.restart_ms} ms after bus-off" if state.restart_ms else never,
        "once bus-off, the bus stays lost until somebody sets the interface up again",
        f"{command}; for good: RestartSec=100ms in section [CAN] of its file in /etc/systemd/network",
        fits=bool(state.restart_ms),
    )


def _bit_rate(name: str, found: int | None, wanted: int | None, setting: tuple[str, str]) -> Finding:
    """One bit rate, bit/s; its key in the robot file, and the command that sets it."""
    key, command = setting
    if found is None:
        effect = "where it is not that of the drives, nothing gets through"
        return warning(name, _UNKNOWN, effect, f"compare it with the drives; to set it: {command}")
    if wanted is not None and found != wanted:
        return bad(
            name,
            f"{found} bit/s, the robot file has {wanted}",
            "nothing gets through, and the bus of everybody else is disturbed",
            f"{command}; or correct hardware.can.{key} in the robot file",
        )
    return good(name, f"{found} bit/s")


def check_drives(_machine: System, workload: Workload) -> Iterator[Finding]:
    """How long a drive goes on by itself, how that is made sure, and whether it outlasts a late cycle."""
    if workload.hardware is None:
        yield good("drives' watchdogs", "no drives" if workload.robot is not None else "no robot is named")
        return
    family = family_of(workload.hardware)
    seconds, how, remedy = family.watchdog(workload.hardware)
    period_s, found = workload.period_ns * 1e-9, f"{seconds * 1e3:g} ms, {how}"
    fits = seconds >= _CYCLES * period_s
    yield graded(
        "drives' watchdogs",
        found if fits else f"{found}; the loop's period is {period_s * 1e3:g} ms",
        f"fewer than {_CYCLES} cycles: one that is late or lost may switch the motors off",
        "a longer hardware.watchdog_s in the robot file (VESC: timeout_set_s, and VESC Tool), or a faster model",
        fits=fits,
    )
    if seconds > _LONG_WATCHDOG_S:
        yield _residual(workload.hardware, seconds, remedy)
    to_check = None if family.to_check is None else family.to_check(workload.hardware)
    if to_check is not None:
        yield warning(*to_check)


def _residual(hardware: HardwareSettings, seconds: float, remedy: str) -> Finding:
    """What is left where drives go on for long by themselves, as it is with a guard and without one."""
    has_guard = hardware.guard == "required"
    found = "the guard alone ends a dead node's torque" if has_guard else "without a guard nothing does sooner"
    effect = (
        f"a cut cable, an unplugged adapter or a computer that dies leaves the torque on for {seconds * 1e3:.0f} ms"
    )
    if not has_guard:
        effect += ", and so does a node that dies while no guard runs"
        remedy += "; hardware.guard: required"
    return warning("drives' watchdogs, residual risk", f"{seconds * 1e3:.0f} ms: {found}", effect, remedy)


def check_serial(machine: System, workload: Workload) -> Iterator[Finding]:
    """Whether the ports of the robot file are there, open, and will have the same name tomorrow."""
    hardware = workload.hardware
    only = hardware.serial if isinstance(hardware, SerialOnlySettings) else None
    settings = only or (None if hardware is None else serial_of(hardware))
    imu = None if hardware is None else imu_line(hardware)
    if settings is None and imu is None:
        yield good("serial line", "none is asked for")
    if settings is not None:
        effect = "the drives are out of reach" if only else "when the bus is lost there is nothing to fall back on"
        yield from _check_port(machine, f"serial {settings.port}", settings, effect)
    if imu is not None:
        effect = "the IMU is out of reach, and a robot that needs it does not arm"
        yield from _check_port(machine, f"IMU serial {imu.serial.port}", imu.serial, effect)


def _check_port(machine: System, title: str, settings: PortSettings, effect: str) -> Iterator[Finding]:
    """One port; `effect` is what it is without it."""
    try:
        machine.probes.open_port(settings)
    except OSError as error:
        grade = bad
        if error.errno in _TAKEN:
            grade, effect = warning, "as it should be while the robot runs; else the robot cannot open it"
        yield grade(title, f"does not open: {error.strerror or error}", effect, open_remedy(settings, error))
    else:
        yield good(title, "opens")
    if _NUMBERED_AS_FOUND.fullmatch(settings.port):
        yield warning(
            f"{title} name",
            "numbered in the order in which adapters are found",
            "with a second adapter, or after it was unplugged, the name may be another one's",
            "write a name that stays: /dev/segway-serial (udev rule), or one of: ls -l /dev/serial/by-id",
        )
