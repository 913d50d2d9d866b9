# SPDX-License-Identifier: MIT
"""Time in lock step stops where a source is to act."""

from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000


class Bell:
    """Acts at given times, and notes when it did."""

    def __init__(self, rig: LockstepRig, *at_ms: int) -> None:
        self.rig = rig
        self.waiting = [ms * MS for ms in at_ms]
        self.rang_ms: list[float] = []

    @property
    def next_ns(self) -> int | None:
        return self.waiting[0] if self.waiting else None

    def act(self) -> None:
        self.waiting.pop(0)
        self.rang_ms.append(self.rig.now_ns() / MS)


def test_each_source_acts_at_its_own_times_and_no_other() -> None:
    rig = LockstepRig(500_000)
    often, seldom = Bell(rig, 1, 2, 3, 7), Bell(rig, 2, 30)
    rig.add(often)
    rig.add(seldom)
    rig.sleep_until_ns(3 * MS)
    assert (often.rang_ms, seldom.rang_ms) == ([1, 2], [2])
    assert rig.now_ns() == 3 * MS
    rig.sleep_until_ns(10 * MS)
    assert (often.rang_ms, seldom.rang_ms) == ([1, 2, 3, 7], [2])
    assert rig.now_ns() == 10 * MS


def test_what_is_due_already_acts_before_time_goes_on() -> None:
    rig = LockstepRig(500_000)
    rig.sleep_until_ns(20 * MS)
    late = Bell(rig, 5)
    rig.add(late)
    rig.sleep_until_ns(25 * MS)
    assert late.rang_ms == [20]
    assert rig.now_ns() == 25 * MS


def test_without_sources_it_is_a_plain_rig() -> None:
    rig = LockstepRig(500_000)
    rig.sleep_until_ns(4 * MS)
    assert rig.now_ns() == 4 * MS
