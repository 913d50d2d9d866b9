# SPDX-License-Identifier: MIT
"""A CANopen node of the canopen library's own making, at the other end of a link in memory."""

import io
from collections.abc import Mapping
from typing import Any, Final

import canopen
import pytest
from canopen import LocalNode
from canopen.objectdictionary import import_od

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState

U8, U16, U32, I8, I16, I32 = 5, 6, 7, 2, 3, 4

OBJECTS: Final[Mapping[int, tuple[int, str, int]]] = {
    0x1000: (U32, "ro", 0x00020192),
    0x1001: (U8, "ro", 0),
    0x1005: (U32, "rw", 0x80),
    0x1006: (U32, "rw", 0),
    0x1017: (U16, "rw", 0),
    0x6007: (I16, "rw", 1),
    0x6040: (U16, "rww", 0),
    0x6041: (U16, "ro", 0x0240),
    0x605A: (I16, "rw", 2),
    0x6060: (I8, "rww", 0),
    0x6061: (I8, "ro", 0),
    0x6064: (I32, "ro", 0),
    0x606C: (I32, "ro", 0),
    0x6071: (I16, "rww", 0),
    0x6076: (U32, "rw", 1_250),
    0x6077: (I16, "ro", 0),
    0x6079: (U32, "ro", 24_000),
    0x6502: (U32, "ro", 0x208),
}
"""Type, access and default, as a manufacturer's EDS gives them."""


def eds(node_id: int, without: frozenset[int] = frozenset()) -> io.StringIO:
    """The EDS of a small drive."""
    variables: dict[tuple[int, int | None], tuple[int, str, int]] = {
        (index, None): entry for index, entry in OBJECTS.items()
    }
    variables |= {(0x1016, 0): (U8, "ro", 1), (0x1016, 1): (U32, "rw", 0)}
    variables |= {(0x1018, 0): (U8, "ro", 2), (0x1018, 1): (U32, "ro", 0x2E8), (0x1018, 2): (U32, "ro", 0x10)}
    variables |= {(0x60C2, 0): (U8, "ro", 2), (0x60C2, 1): (U8, "rw", 1), (0x60C2, 2): (I8, "rw", -3)}
    for base, first in ((0x1400, 0x200), (0x1800, 0x180)):
        for number in range(4):
            index = base + number
            cob_id = 0xC0000000 | (first + 0x100 * number + node_id)
            variables |= {(index, 0): (U8, "ro", 2), (index, 1): (U32, "rw", cob_id), (index, 2): (U8, "rw", 255)}
            variables |= {(index + 0x200, place): (U32 if place else U8, "rw", 0) for place in range(9)}
    kept = {key: entry for key, entry in variables.items() if key[0] not in without}
    text = "[FileInfo]\nFileName=small.eds\n[DeviceInfo]\nVendorName=test\n"
    for index in sorted({key[0] for key, _ in kept.items() if key[1] is not None}):
        text += f"[{index:04X}]\nParameterName=object {index:04X}\nObjectType=0x9\n"
    for (index, subindex), (data_type, access, default) in kept.items():
        section = f"{index:04X}" if subindex is None else f"{index:04X}sub{subindex}"
        text += f"[{section}]\nParameterName=object {section}\nObjectType=0x7\nDataType=0x{data_type:04X}\n"
        text += f"AccessType={access}\nDefaultValue={default}\nPDOMapping=1\n"
    file = io.StringIO(text)
    file.name = "small.eds"
    return file


class Peer(canopen.Network):
    """The library's end of the link: what it sends arrives at ours at once, and it starts no thread."""

    def __init__(self, link: "MemoryLink") -> None:
        super().__init__()
        self._memory = link

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:  # noqa: FBT001, FBT002, ARG002 - the library's
        self._memory.arrived.append(Frame(can_id, bytes(data), self._memory.now_ns))

    def send_periodic(self, *_args: Any, **_more: Any) -> Any:
        class Task:
            def stop(self) -> None: ...
            def update(self, data: bytes) -> None: ...

        return Task()


class MemoryLink:
    """A link on which the library's nodes answer, on a clock that passes only while somebody waits."""

    description = "memory"
    state = LinkState.ACTIVE
    health: Mapping[str, str] = {}

    def __init__(self) -> None:
        self.counters = LinkCounters()
        self.now_ns = 1_000_000_000
        self.sent: list[Frame] = []
        self.arrived: list[Frame] = []
        self.peer = Peer(self)
        self.nodes: dict[int, LocalNode] = {}
        self.is_full = False
        self.is_gone = False
        self.waited: list[int] = []

    def add(self, node_id: int, without: frozenset[int] = frozenset()) -> LocalNode:
        node = LocalNode(node_id, import_od(eds(node_id, without), node_id))
        self.peer.add_node(node)
        self.nodes[node_id] = node

        def display(index: int, **_: Any) -> int | None:
            return node.data_store.get(0x6060, {}).get(0, b"\0")[0] if index == 0x6061 else None

        node.add_read_callback(display)  # type: ignore[no-untyped-call]  # canopen's
        return node

    def clock(self) -> int:
        return self.now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.waited.append(deadline_ns - self.now_ns)
        self.now_ns = max(self.now_ns, deadline_ns)

    def open(self) -> None: ...

    def close(self) -> None: ...

    def send(self, frame: Frame) -> bool:
        if self.is_full:
            return False
        self.sent.append(frame)
        self.peer.notify(frame.arbitration_id, bytearray(frame.data), 0.0)
        if frame.arbitration_id == 0 and frame.data[0] == 0x82 and frame.data[1] in self.nodes:
            self.arrived.append(Frame(0x700 + frame.data[1], b"\0", self.now_ns))
        return True

    def receive(self) -> list[Frame]:
        if self.is_gone:
            raise LinkLostError("memory is gone")
        frames = list(self.arrived)
        self.arrived.clear()
        return frames

    def heard(self) -> list[tuple[int, str]]:
        """Everything that was sent since the last call."""
        frames = [(frame.arbitration_id, frame.data.hex()) for frame in self.sent]
        self.sent.clear()
        return frames


@pytest.fixture
def memory() -> MemoryLink:
    """A link with nobody on it."""
    return MemoryLink()
