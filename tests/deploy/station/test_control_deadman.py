# SPDX-License-Identifier: MIT
import math

import pytest

from segway_ecc.deploy.station.control import DeadMan, fitted
from segway_ecc.node.cycle.setpoints import Setpoint

MS = 1_000_000
LIMITS = Setpoint(3.0, 6.0)


def zeros(dead_man: DeadMan, until_ms: int, start_ms: int = 0) -> list[tuple[int, bool]]:
    """When zeros are sent, looked at every 10 ms, and whether each was because nobody renewed."""
    return [(now, why) for now in range(start_ms, until_ms, 10) for _, why in dead_man.zeros_due(now * MS)]


def test_a_setpoint_that_is_not_renewed_becomes_zeros_and_then_silence() -> None:
    dead_man = DeadMan()
    dead_man.renew("/a", 0)
    assert zeros(dead_man, 2000) == [(310, True), (350, False), (390, False), (430, False), (470, False)]
    assert not dead_man.drives("/a")


def test_one_that_is_renewed_goes_on() -> None:
    dead_man = DeadMan()
    for now in range(0, 1000, 300):
        assert not zeros(dead_man, now + 1, now)
        dead_man.renew("/a", now * MS)
    assert not zeros(dead_man, 1201, 900)


def test_zero_is_sent_at_once_and_again() -> None:
    dead_man = DeadMan()
    dead_man.renew("/a", 0)
    dead_man.release("/a", 100 * MS)
    assert zeros(dead_man, 1000, 100) == [(100, False), (140, False), (180, False), (220, False), (260, False)]


def test_driving_on_ends_the_zeros() -> None:
    dead_man = DeadMan()
    dead_man.renew("/a", 0)
    dead_man.release("/a", 0)
    assert len(zeros(dead_man, 50)) == 2
    dead_man.renew("/a", 50 * MS)
    assert not zeros(dead_man, 350, 50)


def test_zeros_that_are_repeated_do_not_begin_anew() -> None:
    dead_man = DeadMan()
    dead_man.renew("/a", 0)
    dead_man.release("/a", 0)
    assert zeros(dead_man, 90) == [(0, False), (40, False), (80, False)]
    dead_man.release("/a", 90 * MS)
    assert zeros(dead_man, 1000, 90) == [(120, False), (160, False)]


def test_who_was_not_driven_is_sent_nothing() -> None:
    dead_man = DeadMan()
    dead_man.release("/a", 0)
    dead_man.release("/a", 0)
    assert not zeros(dead_man, 1000)


def test_setpoints_are_cut_to_the_limits() -> None:
    assert fitted(9.0, -9.0, LIMITS) == (3.0, -6.0)
    assert fitted(-3.0, 6.0, LIMITS) == (-3.0, 6.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    assert fitted(bad, 0.0, LIMITS) is None
    assert fitted(0.0, bad, LIMITS) is None
