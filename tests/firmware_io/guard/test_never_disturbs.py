# SPDX-License-Identifier: MIT
"""A healthy robot that loses one frame in a hundred is never stopped by its guard."""

import random
from typing import Any

import pytest

from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.rig.fronts import LinkFront

MS = 1_000_000
MINUTE = 6_000
"""Cycles at 100 Hz."""


class Lossy(LinkFront):
    """A link that loses frames both ways, the same ones every time."""

    def __init__(self, link: Link, seed: int, share: float = 0.01) -> None:
        super().__init__(link)
        self.lost = 0
        self._chance = random.Random(seed)  # noqa: S311 - losses, and the same every time
        self._share = share

    def send(self, frame: Frame) -> bool:
        return True if self._loses() else self.behind.send(frame)

    def receive(self) -> list[Frame]:
        return [frame for frame in self.behind.receive() if not self._loses()]

    def _loses(self) -> bool:
        is_lost = self._chance.random() < self._share
        self.lost += is_lost
        return is_lost


@pytest.mark.parametrize(
    ("robot", "minutes"),
    [
        ("cart-can", 2.0),
        ("cart-odrive", 0.1),
        ("cart-vesc", 0.1),
        ("cart-cia402", 0.1),
        pytest.param("cart-can", 10.0, marks=[pytest.mark.proof, pytest.mark.timeout(1_800)]),
        pytest.param("cart-odrive", 10.0, marks=[pytest.mark.proof, pytest.mark.timeout(1_800)]),
        pytest.param("cart-vesc", 10.0, marks=[pytest.mark.proof, pytest.mark.timeout(1_800)]),
        pytest.param("cart-cia402", 10.0, marks=[pytest.mark.proof, pytest.mark.timeout(1_800)]),
    ],
)
def test_a_healthy_robot_with_a_lossy_bus(guarded: Any, robot: str, minutes: float) -> None:
    lossy: list[Lossy] = []

    def lossy_guard(link: Link) -> Link:
        lossy.append(Lossy(link, 2))
        return lossy[0]

    g = guarded(robot, wrap_guard=lossy_guard)
    g.arm()
    g.bus.behind = Lossy(g.bus.behind, 1)
    g.plant._steps = 0  # where the cart is has no part in this, and takes half of the time
    cycles = round(minutes * MINUTE)
    for cycle in range(cycles):
        g.cycle((1.0, 1.0) if cycle % 200 < 100 else (0.0, 0.0))
        g.moments.clear()

    assert g.watch.intervened == 0
    assert g.guard_link.counters.sent == 0
    assert lossy[0].lost > 50 * minutes
    # And it would have acted, had the node died.
    g.cycle((1.0, 1.0))
    g.kill()
    g.wait(60)
    assert g.watch.intervened == 1
