# SPDX-License-Identifier: MIT
"""Links and lines that lose, spoil, repeat and delay what passes, as faults make them."""

from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.faults.fault import Injection, Injections, Target, active
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault, LinkFront
from segway_ecc.hil.rig.simulated_bus import NowNs
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial

_FAULTS: Final = {"off": LinkFault.CUT, "stuck": LinkFault.QUEUE_FULL, "stale": LinkFault.STALE}
_MOST_BITS: Final = 3


class DisturbedBus(FaultyLink):
    """The robot's end of its bus; see `Link`. Where the process behind it `is_dead`, nothing that it sends arrives."""

    def __init__(self, link: Link, injections: Injections, now_ns: NowNs) -> None:
        """Stand in front of `link`."""
        super().__init__(link)
        self.is_dead = False
        self._injections = injections.of("can")
        self._repeats = any(injection.fault.type == "wrong" for injection in self._injections)
        self._now_ns = now_ns
        self._out: deque[tuple[int, Frame]] = deque()
        self._in: deque[tuple[int, Frame]] = deque()
        self._newest: dict[tuple[int, bool], Frame] = {}

    def send(self, frame: Frame) -> bool:
        """Send, or what the faults make of it; see `Link.send`."""
        if self.is_dead:
            return True
        faults = self._set_fault()
        if self.fault is not None:
            return super().send(frame)
        if not faults and not self._out:
            self._remember((frame,), is_sent=True)
            return self.behind.send(frame)
        self._out.extend(self._disturbed(frame, faults, is_sent=True))
        return self._flush()

    def receive(self) -> list[Frame]:
        """Receive, or what the faults make of it; see `Link.receive`."""
        faults = self._set_fault()
        frames = super().receive()
        if not faults and not self._in and not self._out:
            self._remember(frames, is_sent=False)
            return frames
        for frame in frames:
            self._in.extend(self._disturbed(frame, faults, is_sent=False))
        self._flush()
        return [replace(frame, received_ns=max(due_ns, frame.received_ns)) for due_ns, frame in self._due(self._in)]

    def _set_fault(self) -> Sequence[Injection]:
        """Fail as a whole where that is asked for; returns what is there now."""
        self.fault = None
        if not self._injections:
            return ()
        faults = active(self._injections)
        if faults:
            self.fault = next((_FAULTS[i.fault.type] for i in faults if i.fault.type in _FAULTS), None)
        return faults

    def _remember(self, frames: Sequence[Frame], *, is_sent: bool) -> None:
        if self._repeats:
            for frame in frames:
                self._newest[frame.arbitration_id, is_sent] = frame

    def _flush(self) -> bool:
        """Send what is due; False where something was not taken."""
        taken = [super(DisturbedBus, self).send(frame) for _, frame in self._due(self._out)]
        return all(taken)

    def _due(self, queue: deque[tuple[int, Frame]]) -> list[tuple[int, Frame]]:
        due, now_ns = [], self._now_ns()
        while queue and queue[0][0] <= now_ns:
            due.append(queue.popleft())
        return due

    def _disturbed(self, frame: Frame, faults: Sequence[Injection], *, is_sent: bool) -> list[tuple[int, Frame]]:
        """What becomes of a frame, with the time when it goes on."""
        frames, delay_ns = [frame], 0
        for injection in faults:
            match injection.fault.type:
                case "intermittent":
                    frames = [] if injection.happens() else frames
                case "garbage":
                    frames = [_spoilt(f, injection) if injection.happens() else f for f in frames]
                case "wrong":
                    older = self._newest.get((frame.arbitration_id, is_sent))
                    frames += [] if older is None else [replace(older, received_ns=frame.received_ns)]
                case "swapped":
                    frames = [replace(f, data=f.data[::-1]) for f in frames]
                case "delayed":
                    delay_ns += round(injection.size * 1e9)
        self._remember((frame,), is_sent=is_sent)
        begun_ns = self._now_ns() if is_sent else frame.received_ns
        return [(begun_ns + delay_ns, f) for f in frames]


def _spoilt(frame: Frame, injection: Injection) -> Frame:
    """A frame with one to three bits of its data wrong."""
    if not frame.data:
        return frame
    bits = int.from_bytes(frame.data, "little")
    for place in injection.random.sample(range(8 * len(frame.data)), injection.random.randint(1, _MOST_BITS)):
        bits ^= 1 << place
    return replace(frame, data=bits.to_bytes(len(frame.data), "little"))


class DisturbedDevicesLink(LinkFront):
    """The devices' end of the bus: an IMU that is off sends nothing, and without supply nobody does; see `Link`.

    `on_send` is called with each frame that they send.
    """

    def __init__(self, link: Link, injections: Injections, imu_frames: Collection[tuple[int, bool]]) -> None:
        """Stand in front of `link`; `imu_frames` are the IMU's identifiers, and whether they are extended."""
        super().__init__(link)
        self.on_send: Callable[[Frame], None] | None = None
        self._imu = injections.of("imu")
        self._battery = injections.of("battery")
        self._imu_frames = imu_frames

    def send(self, frame: Frame) -> bool:
        """Send, unless the sender is silent."""
        if self._battery and _is_off(self._battery):
            return True
        if self._imu and (frame.arbitration_id, frame.is_extended) in self._imu_frames:
            losses = [i for i in active(self._imu) if i.fault.type in {"off", "intermittent"}]
            if any(i.fault.type == "off" or i.happens() for i in losses):
                return True
        if self.on_send is not None:
            self.on_send(frame)
        return self.behind.send(frame)

    def receive(self) -> list[Frame]:
        """Receive, unless nobody has supply."""
        frames = self.behind.receive()
        return [] if self._battery and _is_off(self._battery) else frames


def _is_off(battery: Sequence[Injection]) -> bool:
    return any(injection.fault.type == "off" for injection in active(battery))


class DisturbedLine:
    """Cuts, unplugs or disturbs a serial line, once in every tick of the rig."""

    def __init__(self, wires: SimulatedSerial, injections: Injections, tick_ns: int) -> None:
        """Disturb `wires`."""
        self._wires = wires
        self._injections = injections.of("serial")
        self._battery = injections.of("battery")
        self._tick_s = tick_ns * 1e-9
        self._is_unplugged = False

    def act(self) -> None:
        """Do what is due now."""
        if not self._injections and not self._battery:
            return
        faults = {i.fault.type: i for i in active(self._injections)}
        is_cut = "off" in faults or _is_off(self._battery)
        if is_cut != self._wires.cut:
            self._wires.cut = is_cut
        if ("stuck" in faults) != self._is_unplugged:
            self._is_unplugged = "stuck" in faults
            (self._wires.host.unplug if self._is_unplugged else self._wires.host.plug)()
        if "garbage" in faults:
            noise = faults["garbage"]
            expected = noise.size * self._tick_s
            count = int(expected) + (noise.random.random() < expected % 1.0)
            if count:
                self._wires.host.inject(noise.random.randbytes(count))


class CutOnlyLine:
    """Cuts a serial line that drives or an IMU have in place of a bus, once in every tick of the rig.

    It is cut where the bus would be, where the IMU is off, and where there is no supply. The frames that `DisturbedBus`
    keeps from it are not all: at its end a node repeats the last command that it wrote.
    """

    def __init__(self, wires: SimulatedSerial, injections: Injections, *targets: Target) -> None:
        """Cut `wires` while one of the targets is off."""
        self._wires = wires
        self._injections = injections.of(*targets)

    def act(self) -> None:
        """Do what is due now."""
        is_cut = any(injection.fault.type == "off" for injection in active(self._injections))
        if is_cut != self._wires.cut:
            self._wires.cut = is_cut
