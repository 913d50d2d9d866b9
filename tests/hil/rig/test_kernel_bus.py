"""Both ends of a kernel's bus know each other, so that neither hurries ahead."""

import pytest

from segway_ecc.firmware_io.links.link import Link
from segway_ecc.hil.rig import kernel_bus
from segway_ecc.hil.rig.kernel_bus import kernel_ends
from segway_ecc.hil.rig.lockstep import LockstepRig


def test_each_end_waits_for_the_other_on_the_rigs_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, made = LockstepRig(500_000), list[object]()

    def make(*words: object) -> Link:
        made.append(words)
        return rig.bus.attach("any")

    monkeypatch.setattr(kernel_bus, "make_can_link", make)
    robot, plant = kernel_ends(rig, ("can0", "can1"), 250_000)
    assert (robot.other, plant.other) == (plant, robot)
    assert made == [("socketcan", name, 250_000, rig.now_ns, rig.wall_ns) for name in ("can0", "can1")]
