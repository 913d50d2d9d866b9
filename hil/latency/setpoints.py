# SPDX-License-Identifier: MIT
"""Publishes set-points at random phases of the loop: each another number, its time noted before it is published."""

import random
import time
from collections.abc import Callable
from typing import Final

from segway_ecc.hil.latency.result import Timed

STEP: Final = 0.001
"""Set-points differ by this, m/s: one count of the wheel board's voltage, V."""
MOST: Final = 9000
_LEAST_PERIODS: Final = 2.0
_MORE_PERIODS: Final = 1.0


def publish_all(count: int, period_s: float, send: Callable[[float], None], *, seed: int = 1) -> list[Timed]:
    """Publish so many set-points, two to three periods apart, so that none overtakes another.

    Args:
        count: How many, up to `MOST`.
        period_s: Of the loop, s.
        send: Publishes one, m/s.
        seed: Of the times between them.
    """
    chance = random.Random(seed)  # noqa: S311 - chance that can be repeated is what is wanted
    published = []
    for number in range(1, count + 1):
        time.sleep(period_s * (_LEAST_PERIODS + _MORE_PERIODS * chance.random()))
        published.append(Timed(number, time.monotonic_ns()))
        send(number * STEP)
    return published
