# SPDX-License-Identifier: MIT
"""Our drive families keep what the software relies on, and one that does not is found out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import pytest

from segway_ecc.firmware_io.devices import Drive, FrameKey
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog, family_of
from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId
from segway_ecc.firmware_io.drives.wheel_board.stopper import SessionBoardStopper
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.conformance.kit import CONFORMANCE_ASPECTS, check_conformance
from segway_ecc.hil.conformance.rig import NonconformanceError
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.devices.family import SimulatedDrives, simulated_drives
from segway_ecc.hil.devices.wheel_board import SimulatedWheelBoard
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import load_robot


@pytest.mark.parametrize("aspect", CONFORMANCE_ASPECTS)
@pytest.mark.parametrize(
    "robot", ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402", "cart-hoverboard", "cart-moteus"]
)
def test_our_families_conform(robot: str, aspect: str) -> None:
    settings = hardware_of(load_robot(robot))
    check_conformance(aspect, family_of(settings), simulated_drives(settings), settings)


@pytest.mark.parametrize("aspect", CONFORMANCE_ASPECTS)
@pytest.mark.parametrize("names", [("pan",), ("base", "elbow", "wrist", "grip")], ids=len)
@pytest.mark.parametrize("robot", ["cart-odrive", "cart-vesc", "cart-cia402", "cart-moteus"])
def test_our_families_conform_with_any_number_of_axes(robot: str, names: Sequence[str], aspect: str) -> None:
    settings: Any = hardware_of(load_robot(robot))
    left, right = settings.axes.values()
    number = {"cart-vesc": "controller_id", "cart-moteus": "servo_id"}.get(robot, "node_id")
    axes = {name: msgspec.structs.replace(right if n % 2 else left, **{number: n + 1}) for n, name in enumerate(names)}
    can = msgspec.structs.replace(settings.can, bitrate=1_000_000)
    settings = msgspec.structs.replace(settings, axes=axes, can=can)
    check_conformance(aspect, family_of(settings), simulated_drives(settings), settings)


class Altered:
    """Simulated drives whose motors give something else than the drives do; see `Device`."""

    def __init__(self, device: Device, alter: Callable[[float], float]) -> None:
        self.inputs, self.needs = device.inputs, device.needs
        self._device, self._alter = device, alter

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        return [self._alter(value) for value in self._device.obey(frames, now_ns, outputs)]

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        self._device.send_telemetry(now_ns, outputs)

    @property
    def refused_frames(self) -> int:
        return self._device.refused_frames


class Unfit(Altered):
    """Gives what no driver commands."""

    def __init__(self, device: Device, alter: Callable[[float], float]) -> None:
        super().__init__(device, alter)
        self.inputs = ("pan.torque",)


class NoStop(SessionBoardStopper):
    """Stops nothing."""

    def stop(self) -> Sequence[Frame]:
        return []


class NoReading(SessionBoardStopper):
    """Reads nothing."""

    def read(self, _frame: Frame) -> None:
        return None


BOARD = hardware_of(load_robot("cart-can"))
FAMILY, SIMULATED = family_of(BOARD), simulated_drives(BOARD)


def altered(alter: Callable[[float], float]) -> SimulatedDrives[Any, Any]:
    return replace(SIMULATED, device=lambda *parts: Altered(SIMULATED.device(*parts), alter))


def without_watchdog(*parts: Any) -> Device:
    device: SimulatedWheelBoard = SIMULATED.device(*parts)
    device.has_watchdog = False
    return device


def drives_with(**changes: object) -> DriveFamily[Any]:
    def drives(*parts: Any) -> Sequence[Drive]:
        made = FAMILY.drives(*parts)
        for name, value in changes.items():
            setattr(made[0], name, value)
        return made

    return replace(FAMILY, drives=drives)


WRONG = {
    "a motor that is never off": ("arming", FAMILY, altered(lambda value: value + 1.0), "before the drives are armed"),
    "a motor that turns back": ("direction", FAMILY, altered(lambda value: -value), "its motor gives -15"),
    "a motor that gives less": ("scale", FAMILY, altered(lambda value: 0.9 * value), "its motor gives 13.5"),
    "a stopper that does nothing": ("stop", replace(FAMILY, stopper=lambda _: NoStop()), SIMULATED, "after the stop"),
    "a stopper that reads nothing": (
        "stop",
        replace(FAMILY, stopper=lambda _: NoReading()),
        SIMULATED,
        "the stopper reads no command that moves board",
    ),
    "a watchdog that is missing": (
        "watchdog",
        FAMILY,
        replace(SIMULATED, device=without_watchdog),
        "70 ms without commands (watchdog 40 ms) the motors give",
    ),
    "a watchdog that takes longer": (
        "watchdog",
        replace(FAMILY, watchdog=lambda _: DriveWatchdog(-0.02, "a wrong figure")),
        SIMULATED,
        "the motors give",
    ),
    "telemetry at another rate": (
        "timing",
        drives_with(periods_s={FrameKey(int(FrameId.WHEEL_COMMAND)): 0.001}),
        SIMULATED,
        "and not 1000 times as periods_s has it",
    ),
    "a motor that nobody commands": (
        "arming",
        FAMILY,
        replace(SIMULATED, device=lambda *parts: Unfit(SIMULATED.device(*parts), lambda value: value)),
        "nothing commands pan.torque",
    ),
}


@pytest.mark.parametrize(("aspect", "family", "simulated", "problem"), WRONG.values(), ids=list(WRONG))
def test_what_does_not_conform_is_named(
    aspect: str, family: DriveFamily[Any], simulated: SimulatedDrives[Any, Any], problem: str
) -> None:
    with pytest.raises(NonconformanceError) as caught:
        check_conformance(aspect, family, simulated, BOARD)
    assert str(caught.value).startswith(f"wheel_board, {aspect}: ")
    assert problem in str(caught.value)
