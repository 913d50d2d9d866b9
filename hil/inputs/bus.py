# SPDX-License-Identifier: MIT
"""Item 6: strangers on the bus, and the guard."""

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import Final

import msgspec

from segway_ecc.firmware_io.build import can_link
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.firmware_io.drives.stopper import Meaning
from segway_ecc.firmware_io.guard.guard import stopper_of
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.inputs.rig import Arrangement, Rig
from segway_ecc.hil.inputs.trial import Event, InputTrial, balances, ends, falls, rests
from segway_ecc.hil.processes import ProcessFailedError, command, last_lines
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import load_robot

_ITEM: Final = 6
_NOT_THERE: Final = 4
_RECORDED: Final = 20
_RECORDED_WITHIN_S: Final = 5.0
_PERIOD_S: Final = 0.005
_REPLAYED_S: Final = 1.0
_NEEDS_GUARD: Final = (("  watchdog_s: 0.04", "  guard: required\n  watchdog_s: 0.04"),)
_OUTSIDER: Final = "command frames that this node did not send"


class BusStranger:
    """Another participant of the robot's bus."""

    def __init__(self, rig: Rig, link: Link) -> None:
        """Take part by `link`."""
        hardware, clock = hardware_of(load_robot(str(rig.file))), RealClock()
        self._stopper = stopper_of(hardware)
        drives = family_of(hardware).drives(hardware, link, _PERIOD_S, clock)
        self._commands = frozenset(key for drive in drives for key in drive.commanded_by)
        self._link = link

    def record(self) -> list[Frame]:
        """The next commands of the node, all their frames, until so many have moved a drive.

        Raises:
            ProcessFailedError: There were none.
        """
        deadline, found, moved = time.monotonic() + _RECORDED_WITHIN_S, list[Frame](), 0
        while moved < _RECORDED:
            if time.monotonic() > deadline:
                raise ProcessFailedError("no drive is moved on the bus")
            for frame in self._link.receive():
                moved += self._moves(frame)
                if (frame.arbitration_id, frame.is_extended) in self._commands:
                    found.append(frame)
            time.sleep(_PERIOD_S)
        return found

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames, at once."""
        for frame in frames:
            self._link.send(frame)

    def _moves(self, frame: Frame) -> bool:
        observed = self._stopper.read(frame)
        return observed is not None and observed.meaning is Meaning.MOVE


@contextlib.contextmanager
def stranger(rig: Rig) -> Iterator[BusStranger]:
    """One on the bus as long as the context lasts."""
    settings = hardware_of(load_robot(str(rig.file))).line
    if not isinstance(settings, CanSettings):
        raise RigError(f"robot '{rig.file}' is on no CAN bus, which a stranger could join")
    settings = msgspec.structs.replace(settings, interface="local", channel=rig.parts.setup.channel)
    with contextlib.closing(can_link(settings, RealClock())) as link:
        link.open()
        yield BusStranger(rig, link)


def _second_run(rig: Rig, undo: ExitStack) -> Event:
    now_ns, messages = time.monotonic_ns(), rig.parts.setup.messages("second")
    words = ["run", str(rig.file), *rig.parts.setup.bus, "--no-ros", "--no-log"]
    second = undo.enter_context(command(words, messages))
    rig.wait(lambda: second.process.poll() is not None, "the second run did not end")
    return Event(now_ns, [last_lines(messages)], second.process.returncode)


def _replay(change: Callable[[Frame], Frame]) -> Callable[[Rig, ExitStack], Event]:
    def do(rig: Rig, undo: ExitStack) -> Event:
        other = undo.enter_context(stranger(rig))
        frames = [change(frame) for frame in other.record()]
        now_ns = time.monotonic_ns()
        other.send(frames[-2:])
        return Event(now_ns)

    return do


def _same(frame: Frame) -> Frame:
    return frame


def _damaged(frame: Frame) -> Frame:
    """Our identifier, with other data, whose checksum is wrong where there is one."""
    return msgspec.structs.replace(frame, data=bytes(byte ^ 0x55 for byte in frame.data))


def _kill_guard(rig: Rig, _undo: ExitStack) -> Event:
    pid = rig.parts.pid("guard")
    now_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGKILL)
    return Event(now_ns)


def _arm(rig: Rig, _undo: ExitStack) -> Event:
    now_ns = time.monotonic_ns()
    rig.wait_for("no guard watches this bus")
    return Event(now_ns)


def _kill_node_and_replay(rig: Rig, undo: ExitStack) -> Event:
    other = undo.enter_context(stranger(rig))
    frames = other.record()
    now_ns = time.monotonic_ns()
    rig.parts.node.process.kill()
    end = time.monotonic() + _REPLAYED_S
    while time.monotonic() < end:
        for frame in frames:
            other.send([frame])
            time.sleep(_PERIOD_S)
    return Event(now_ns)


def trials() -> Sequence[InputTrial]:
    """All of them."""
    guarded = Arrangement(_NEEDS_GUARD)
    return [
        InputTrial(
            _ITEM,
            "a second run on the bus",
            _second_run,
            balances(r"is controlled by process \d+", _NOT_THERE),
            guarded,
        ),
        InputTrial(
            _ITEM,
            "the guard is killed while armed",
            _kill_guard,
            balances("the guard of this bus has ended"),
            guarded,
        ),
        InputTrial(
            _ITEM,
            "arming without the guard that the file requires",
            _arm,
            rests("no guard watches this bus"),
            Arrangement(_NEEDS_GUARD, guard=False, is_armed=False),
        ),
        InputTrial(_ITEM, "our own command frames, replayed", _replay(_same), falls(_OUTSIDER)),
        InputTrial(_ITEM, "our identifiers with other data", _replay(_damaged), falls(_OUTSIDER)),
        InputTrial(
            _ITEM,
            "the node is killed, and its commands replayed for 1 s",
            _kill_node_and_replay,
            ends("guard: stopped the drives", 128 + signal.SIGKILL),
        ),
    ]
