# SPDX-License-Identifier: MIT
from collections.abc import Callable, Sequence

import pytest

from segway_ecc.hil.bench import comparison
from segway_ecc.hil.bench.comparison import ComparisonSetup, ProgramResult, SustainedRates, search
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.rig import Bus, Conditions
from segway_ecc.hil.bench.samples import Cycles
from segway_ecc.hil.process_usage import Memory

Make = Callable[..., Cycles]
NOTHING = Conditions(priority=0, idle_states_off=False, memory_locked=False, cores=2, isolated=(), kernel="6.1")
SETUP = ComparisonSetup(Bus("local", "x", "x"), NOTHING, lambda _: None)


def test_the_highest_rate_ends_where_the_first_cycle_was_late_or_lost(cycles: Make) -> None:
    tried = {1000.0: cycles(), 500.0: cycles(late=1), 100.0: cycles(), 200.0: cycles()}
    assert SustainedRates(tried, {}).in_time_hz == 200.0
    assert SustainedRates(tried, {}).complete_hz == 1000.0
    assert SustainedRates({100.0: cycles(lost=1)}, {}).in_time_hz == 0.0
    assert SustainedRates({100.0: cycles(lost=1)}, {}).complete_hz == 0.0


def test_a_rate_at_which_it_gave_up_is_not_held(cycles: Make) -> None:
    gave_up = SustainedRates({100.0: cycles(), 200.0: cycles()}, {200.0: "telemetry too old"})
    assert (gave_up.in_time_hz, gave_up.complete_hz) == (100.0, 100.0)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, cycles: Make) -> list[tuple[float, tuple[Contestant, ...]]]:
    """What was run: ours is late now and then and gives up at 500 Hz, the user's loop too often from 200 Hz on."""
    made: list[tuple[float, tuple[Contestant, ...]]] = []

    def compare(_: ComparisonSetup, rate_hz: float, hold_s: float, repeats: int, who: Sequence[Contestant]) -> object:
        made.append((rate_hz, tuple(who)))
        assert (hold_s, repeats) == (30.0, 1)
        late = {Contestant.USER: 101 if rate_hz >= 200.0 else 0, Contestant.OURS: 100}  # of 10,000
        fault = "too late" if rate_hz >= 500.0 else None
        return {
            one: ProgramResult(
                cycles(late=late.get(one, 0)), 0.1, Memory(1, 1), None, fault if one is Contestant.OURS else None
            )
            for one in who
        }

    monkeypatch.setattr(comparison, "compare", compare)
    return made


def test_who_fails_by_far_is_not_tried_at_the_next_rate(runs: list[tuple[float, tuple[Contestant, ...]]]) -> None:
    ours, user, limit = Contestant.OURS, Contestant.USER, Contestant.C
    found = search(SETUP, 30.0, (ours, user, limit), (1000.0, 100.0, 500.0, 200.0))
    assert runs == [
        (100.0, (ours, user, limit)),
        (200.0, (ours, user, limit)),
        (500.0, (ours, limit)),
        (1000.0, (limit,)),
    ]
    assert found[limit].in_time_hz == 1000.0
    assert found[user].in_time_hz == 100.0
    assert found[ours].in_time_hz == 0.0
    assert found[ours].complete_hz == 200.0
    assert found[ours].faults == {500.0: "too late"}


def test_the_search_ends_with_the_last_program(runs: list[tuple[float, tuple[Contestant, ...]]]) -> None:
    search(SETUP, 30.0, (Contestant.USER,), (100.0, 200.0, 500.0))
    assert [rate_hz for rate_hz, _ in runs] == [100.0, 200.0]
