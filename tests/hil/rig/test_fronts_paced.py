# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.rig import fronts
from segway_ecc.hil.rig.fronts import PacedLink, kernel_ends
from segway_ecc.hil.rig.simulation import LockstepRig

FRAME = Frame(0x120, b"angle")


class SlowWire:
    """A link on which a frame arrives only after it was looked for a few times."""

    description = "can0"
    state = LinkState.ACTIVE

    def __init__(self, looks: int) -> None:
        self.counters = LinkCounters()
        self.health = {"state": "active"}
        self.arriving: list[Frame] = []
        self.sent: list[Frame] = []
        self.journal: list[str] = []
        self._looks, self._left = looks, looks

    def open(self) -> None:
        self.journal.append("open")

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def receive(self) -> list[Frame]:
        if self.arriving and self._left > 0:
            self._left -= 1
            return []
        frames, self.arriving = self.arriving, []
        self.counters.received += len(frames)
        self._left = self._looks
        return frames

    def close(self) -> None:
        self.journal.append("close")


def ends(looks: int) -> tuple[PacedLink, SlowWire, PacedLink]:
    """The robot's end, its wire, and the plant's end."""
    wire = SlowWire(looks)
    robot, plant = PacedLink(wire, lambda _: None), PacedLink(SlowWire(0), lambda _: None)
    robot.other, plant.other = plant, robot
    return robot, wire, plant


def test_waits_for_what_the_other_end_sent() -> None:
    robot, wire, plant = ends(looks=5)
    plant.send(FRAME)
    wire.arriving.append(FRAME)
    assert robot.receive() == [FRAME]
    assert robot.lost == 0


def test_waits_for_nothing_where_nothing_was_sent() -> None:
    robot, wire, plant = ends(looks=5)
    wire.arriving.append(FRAME)
    assert robot.receive() == [], "a frame of somebody else is not waited for"
    plant.send(Frame(0x120, b"", is_remote=True))
    assert robot.receive() == [], "and a remote frame is no data"
    assert robot.lost == 0


def test_gives_a_lost_frame_up_and_counts_it() -> None:
    robot, wire, plant = ends(looks=0)
    plant.send(FRAME)
    assert robot.receive() == []
    assert robot.lost == 1
    plant.send(FRAME)
    wire.arriving.append(FRAME)
    assert robot.receive() == [FRAME], "the next is not waited for twice"
    assert robot.lost == 1


def test_is_otherwise_the_link_itself() -> None:
    robot, wire, _ = ends(looks=0)
    robot.open()
    assert robot.send(FRAME)
    robot.close()
    assert (wire.journal, wire.sent) == (["open", "close"], [FRAME])
    assert (robot.state, robot.health, robot.counters) == (LinkState.ACTIVE, {"state": "active"}, wire.counters)
    assert robot.description == "can0, in lock step"


def test_each_end_waits_for_the_other_on_the_rigs_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, made = LockstepRig(500_000), list[object]()

    def make(*words: object, fd_bitrate: int | None) -> Link:
        made.append((*words, fd_bitrate))
        return rig.bus.attach("any")

    monkeypatch.setattr(fronts, "make_can_link", make)
    robot, plant = kernel_ends(rig, ("can0", "can1"), CanSettings(bitrate=250_000, fd=True, data_bitrate=2_000_000))
    assert (robot.other, plant.other) == (plant, robot)
    assert made == [("socketcan", name, 250_000, rig.now_ns, rig.wall_ns, 2_000_000) for name in ("can0", "can1")]
