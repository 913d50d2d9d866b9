# SPDX-License-Identifier: MIT
"""Settings in a robot file for an MTi."""

from typing import Annotated, Final, Literal

import msgspec

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.imus.settings import ImuSettings
from segway_ecc.firmware_io.imus.xsens_mti.frames import DEFAULT_IDS, Message

_STANDARD_IDS: Final = 1 << 11
_EXTENDED_IDS: Final = 1 << 29


class XsensMtiSettings(ImuSettings, frozen=True, kw_only=True, tag="xsens_mti"):
    """An MTi of the 600 series on the drives' bus.

    Attributes:
        ids: Arbitration ids other than those it is delivered with, by message.
        extended_ids: Whether all its ids are 29-bit ones.
        sample_time_unit: What one tick of its sample time is; it differs between firmware versions.
        bears_fd: Whether it stands frames of CAN FD on its bus: a 600 itself does not, and destroys them.
    """

    ids: dict[Message, Annotated[int, msgspec.Meta(ge=0, lt=_EXTENDED_IDS)]] = msgspec.field(default_factory=dict)
    extended_ids: bool = False
    sample_time_unit: Literal["100us", "us"] = "100us"
    bears_fd: bool = False

    def __post_init__(self) -> None:
        """Refuse ids that are too large or used twice, and a mounting that is no rotation."""
        super().__post_init__()
        owners: dict[int, Message] = {}
        for message in Message:
            arbitration_id = self.key(message).arbitration_id
            if arbitration_id >= _STANDARD_IDS and not self.extended_ids:
                raise ValueError(f"id 0x{arbitration_id:X} of {message} needs extended_ids: true")
            if arbitration_id in owners:
                raise ValueError(f"{owners[arbitration_id]} and {message} both have id 0x{arbitration_id:X}")
            owners[arbitration_id] = message

    @property
    def sample_time_tick_s(self) -> float:
        """One tick of the sample time, s."""
        return 1e-4 if self.sample_time_unit == "100us" else 1e-6

    def key(self, message: Message) -> FrameKey:
        """What identifies a message on the bus."""
        return FrameKey(self.ids.get(message, DEFAULT_IDS[message]), self.extended_ids)
