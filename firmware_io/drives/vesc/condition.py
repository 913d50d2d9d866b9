# SPDX-License-Identifier: MIT
"""What a controller reports only when asked: its fault, and whether its time-out has acted.

Both are values of the serial protocol, asked for one at a time so that question and answer each fit one CAN frame; see
`buffers`. A serial line gives the same frames.
"""

from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.vesc.buffers import Mode, ShortBuffer, frames_of
from segway_ecc.firmware_io.drives.vesc.frames import TIMED_OUT, ask_selective, decode_values, mask_of
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

HOST_IDS: Final = {"left": 254, "right": 253}
"""Under which identifier this computer asks about each wheel, so that answers can be distinguished."""

FAULT: Final = mask_of(("fault",))
FLAGS: Final = mask_of(("flags",))

_FAULT_NAMES: Final = {
    1: "over-voltage",
    2: "under-voltage",
    3: "gate driver",
    4: "over-current",
    5: "over-temperature of the power stage",
    6: "over-temperature of the motor",
    7: "gate driver over-voltage",
    8: "gate driver under-voltage",
    9: "under-voltage of the processor",
    10: "restarted by its own watchdog",
    11: "encoder",
    18: "unbalanced currents",
    25: "encoder without magnet",
}
"""The codes of VESC's firmware (mc_fault_code in its datatypes.h) that a robot is likely to meet."""


class Answer(NamedTuple):
    """What a controller answered: one of the two, or neither where its firmware does not know what was asked."""

    fault: int | None = None
    timed_out: bool | None = None


def fault_name(code: int) -> str:
    """What a fault code means."""
    return f"{_FAULT_NAMES[code]} (fault {code})" if code in _FAULT_NAMES else f"fault {code}"


def ask(name: str, controller_id: int, mask: int) -> Frame:
    """The frame that asks the controller of the wheel `name` for FAULT or FLAGS."""
    return frames_of(controller_id, HOST_IDS[name], Mode.PROCESS, ask_selective(mask))[0]


def answer(buffer: ShortBuffer, controller_id: int) -> Answer:
    """What a controller's short packet answers.

    Raises:
        FrameRefusedError: It is not an answer of that controller to `ask`.
    """
    if buffer.sender_id != controller_id or buffer.mode is not Mode.PASS_ON:
        raise FrameRefusedError(Refusal.UNKNOWN, f"packet from {buffer.sender_id}")
    mask, values = decode_values(buffer.packet)
    if mask not in (FAULT, FLAGS):
        raise FrameRefusedError(Refusal.UNKNOWN, f"answer to 0x{mask:08X}")
    if "fault" in values:
        return Answer(fault=int(values["fault"]))
    return Answer(timed_out=bool(int(values["flags"]) & TIMED_OUT)) if "flags" in values else Answer()
