# SPDX-License-Identifier: MIT
from collections.abc import Callable
from dataclasses import replace

import pytest

from segway_ecc.hil.bench.comparison import ProgramResult
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.table import Claim, claims

Make = Callable[..., ProgramResult]


def test_cost_is_compared_with_the_users_loop_and_the_limit_and_lateness_with_the_bare_loop(result: Make) -> None:
    found = claims(
        {
            Contestant.OURS: result(60.0, 45.0),
            Contestant.USER: result(300.0, 1.0),
            Contestant.C: result(8.0, 1.0),
            Contestant.BARE: result(1.0, 40.0),
        }
    )
    assert [claim.ratio for claim in found] == pytest.approx([0.2, 7.5, 1.125])
    assert [(claim.limit, claim.is_met) for claim in found] == [(0.25, True), (6.0, False), (1.5, True)]


def test_a_ratio_that_is_the_limit_is_met() -> None:
    assert Claim("x", 6.0, 6.0).as_text() == "x: 6.00, at most 6 wanted: met"
    assert Claim("x", 6.01, 6.0).as_text() == "x: 6.01, at most 6 wanted: NOT met"


def test_what_did_not_run_is_not_judged(result: Make) -> None:
    assert [claim.limit for claim in claims({Contestant.OURS: result(), Contestant.C: result()})] == [6.0]
    assert claims({Contestant.USER: result(), Contestant.C: result()}) == []


def test_too_few_cycles_give_no_thousandth(result: Make) -> None:
    ours = result()
    few = replace(ours, cycles=replace(ours.cycles, count=2999))
    assert claims({Contestant.OURS: few, Contestant.BARE: result()}) == []
    enough = replace(ours, cycles=replace(ours.cycles, count=3000))
    assert [claim.limit for claim in claims({Contestant.OURS: enough, Contestant.BARE: result()})] == [1.5]


def test_a_loop_that_gave_up_has_met_nothing_however_cheap_it_was(result: Make) -> None:
    found = claims({Contestant.OURS: result(1.0, 1.0, "the bus is gone"), Contestant.USER: result(300.0)})
    assert [claim.is_met for claim in found] == [False]
    assert "the bus is gone" in found[0].what


def test_where_ticks_are_coarse_the_means_are_compared(result: Make) -> None:
    def coarse(mean_s: float) -> ProgramResult:
        whole = result(10_000.0)
        cost = replace(whole.cycles.cost, mean_s=mean_s)
        return replace(whole, cycles=replace(whole.cycles, cost=cost, is_coarse=True))

    found = claims({Contestant.OURS: coarse(1e-3), Contestant.C: coarse(5e-4)})
    assert [claim.ratio for claim in found] == pytest.approx([2.0])
    assert "mean" in found[0].what
