# SPDX-License-Identifier: MIT
"""Results of programs that were never run."""

from collections.abc import Callable

import pytest

from segway_ecc.hil.bench.comparison import ProgramResult
from segway_ecc.hil.bench.samples import Cycles, Spread
from segway_ecc.hil.process_usage import Memory


def flat(value_s: float) -> Spread:
    """A distribution that is all one value."""
    return Spread(value_s, value_s, value_s, value_s, value_s)


@pytest.fixture
def cycles() -> Callable[..., Cycles]:
    """Cycles that all cost the same and are all as late, in microseconds."""

    def make(cost_us: float = 100.0, lateness_us: float = 50.0, *, late: int = 0, lost: int = 0) -> Cycles:
        return Cycles(10_000, late, lost, flat(cost_us * 1e-6), flat(lateness_us * 1e-6), {"bus": flat(20e-6)})

    return make


@pytest.fixture
def result(cycles: Callable[..., Cycles]) -> Callable[..., ProgramResult]:
    """What a program with such cycles came to."""

    def make(cost_us: float = 100.0, lateness_us: float = 50.0, fault: str | None = None) -> ProgramResult:
        return ProgramResult(cycles(cost_us, lateness_us), 0.04, Memory(30_000_000, 20_000_000), 0.5, fault)

    return make
