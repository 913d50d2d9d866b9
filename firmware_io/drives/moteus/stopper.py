# SPDX-License-Identifier: MIT
"""What the guard must know of moteus controllers."""

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.drives.moteus import frames as moteus
from segway_ecc.firmware_io.drives.moteus.settings import MoteusSettings
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation, WheelStopper
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_FIRST_READ = 0x10  # sub-frames below it write; the mode must be written first (docs/protocol/registers.md)


class MoteusStopper(WheelStopper):
    """moteus controllers: each is stopped, and asked for its mode."""

    def __init__(self, settings: MoteusSettings) -> None:
        """Know the controllers by their ids."""
        names = {axis.servo_id: name for name, axis in settings.axes.items()}
        routes = [moteus.route(moteus.HOST, servo_id, wants_reply=True) for servo_id in names]
        super().__init__(names, [moteus.frame_to(to, moteus.stop_command(settings.watchdog_s)) for to in routes])
        hosts = (moteus.HOST, moteus.ASIDE)
        self._reports = {moteus.route(servo_id, host): name for servo_id, name in names.items() for host in hosts}

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        name = self._reports.get(FrameKey(frame.arbitration_id, frame.is_extended))
        if name is not None:
            try:
                is_off = moteus.decode_reply(frame).mode in moteus.OFF
            except FrameRefusedError:
                return None
            return Observation(name, Meaning.OFF if is_off else Meaning.ON)
        name = self._names.get(frame.arbitration_id & 0xFF) if frame.arbitration_id >> 16 == 0 else None
        if name is None or frame.is_remote or not frame.data or frame.data[0] >= _FIRST_READ:
            return None
        if frame.data.startswith(moteus.STOP):
            return Observation(name, Meaning.DISABLE)
        return Observation(name, Meaning.ZERO if moteus.is_zero(frame.data) else Meaning.MOVE)
