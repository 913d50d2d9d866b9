# SPDX-License-Identifier: MIT
"""A simulated ODrive that has a pass only where it asks for one, beside one that has it every millisecond."""

import math
import random
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import pytest

from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.odrive import SimulatedOdrive
from tests.hil.devices.odrive_bench import CLOSED, IDLE, MS, MemoryPort, clear, mode, state, torque
from tests.recording_link import RecordingLink


class Side:
    """One of the two, and what it gave and sent."""

    def __init__(self, firmware: str, *, sleeps: bool, port: MemoryPort | None = None) -> None:
        wheel = {"node_id": 0, "axis": 0, "max_torque": 4.0, "torque_constant": 0.5}
        right = {**wheel, "node_id": 1, "axis": 1, "direction": -1}
        described: dict[str, Any] = {"type": "odrive", "firmware": firmware, "axes": {"left": wheel, "right": right}}
        self.link = RecordingLink()
        self.device = SimulatedOdrive(self.link, msgspec.convert(described, OdriveSettings), port)
        self.passes = 0
        self.torques: Sequence[float] = ()
        self._sleeps = sleeps

    def tick(
        self, frames: Sequence[Frame], now_ns: int, before: Mapping[str, float], after: Mapping[str, float]
    ) -> None:
        if self._sleeps and not frames and self.device.next_ns > now_ns:
            return
        self.passes += 1
        self.torques = self.device.obey(frames, now_ns, before)
        self.device.send_telemetry(now_ns, after)

    def seen(self) -> tuple[list[float], list[Frame], list[tuple[int, int]]]:
        return [*self.torques], self.link.frames, [(axis.state, axis.error) for axis in self.device.axes]


def command(chance: random.Random, firmware: str) -> Frame:
    """Any of what a host sends, most often a torque."""
    node, value = chance.randrange(2), chance.uniform(-3.0, 3.0)
    rare = [
        clear(firmware, node),
        state(node, chance.choice([IDLE, CLOSED, CLOSED, 99])),
        mode(node, chance.choice([1, 1, 1, 2, 3]), chance.choice([1, 1, 0])),
        Frame(node << 5 | 0x02, b""),
        Frame(node << 5 | 0x0D, struct.pack("<ff", value, value)),
        Frame(node << 5 | 0x0F, struct.pack("<ff", chance.choice([2.0, math.inf, 50.0]), 40.0)),
        Frame(node << 5 | 0x09, b"", is_remote=True),
        Frame(0x7FF, b"of somebody else"[:8]),
    ]
    return torque(node, value) if chance.random() < 0.7 else chance.choice(rare)


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
@pytest.mark.parametrize("seed", range(3))
def test_a_pass_that_it_sleeps_through_changes_nothing(firmware: str, seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311 - no secret
    always, seldom = Side(firmware, sleeps=False), Side(firmware, sleeps=True)
    outputs = dict.fromkeys(always.device.needs, 0.0)
    for tick in range(4000):
        is_silent = tick % 1000 > 800  # for longer than the watchdog takes
        frames = [] if is_silent else [command(chance, firmware) for _ in range(chance.choice([0, 0, 0, 1, 2]))]
        if tick % 1000 == 10:
            frames = [f for node in (0, 1) for f in (mode(node, 1), torque(node, 0.0), clear(firmware, node))]
            frames += [state(0, CLOSED), state(1, CLOSED)]
        now_ns, before = tick * MS, outputs
        outputs = {name: value + chance.uniform(-0.1, 0.1) for name, value in before.items()}
        for side in (always, seldom):
            side.tick(frames, now_ns, before, outputs)
        assert seldom.seen() == always.seen()
    assert always.passes == 4000
    assert seldom.passes < 3000


def test_where_it_is_let_alone_it_wakes_for_its_telemetry_alone() -> None:
    side = Side("0.5", sleeps=True)
    outputs = dict.fromkeys(side.device.needs, 0.0)
    for tick in range(200):
        side.tick([], tick * MS, outputs, outputs)
    assert side.passes == 41  # every 5 ms, and once as the watchdog expires


def test_it_is_awake_where_a_byte_may_come_and_where_its_power_has_changed() -> None:
    side = Side("0.5", sleeps=True, port=MemoryPort())
    outputs = dict.fromkeys(side.device.needs, 0.0)
    side.tick([], 0, outputs, outputs)
    assert side.device.next_ns == -math.inf
    side = Side("0.5", sleeps=True)
    side.tick([], 0, outputs, outputs)
    for switch in (side.device.switch_off, side.device.switch_on):
        side.device.next_ns = 1e12
        switch()
        assert side.device.next_ns == -math.inf


@pytest.mark.parametrize(
    "limit",
    ["dc_max_negative_current_a", "dc_max_positive_current_a", "velocity_limit_rev_s", "current_limit_margin_a"],
)
def test_a_limit_is_watched_in_every_pass(limit: str) -> None:
    side = Side("0.5", sleeps=True)
    outputs = dict.fromkeys(side.device.needs, 0.0)
    (board,) = side.device.boards
    for part in (board, *side.device.axes):
        if hasattr(part, limit):
            setattr(part, limit, 1e3)
    frames = [f for node in (0, 1) for f in (mode(node, 1), torque(node, 0.0), clear("0.5", node), state(node, CLOSED))]
    for tick in range(20):
        side.tick(frames, tick * MS, outputs, outputs)
        frames = [torque(0, 0.1), torque(1, 0.1)] if tick % 5 == 0 else []
    assert side.device.next_ns == -math.inf
