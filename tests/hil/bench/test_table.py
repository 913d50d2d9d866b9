# SPDX-License-Identifier: MIT
from collections.abc import Callable

from segway_ecc.hil.bench.comparison import ProgramResult, SustainedRates
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.samples import Cycles
from segway_ecc.hil.bench.speed import CampaignSpeed, LockStep
from segway_ecc.hil.bench.table import campaign_text, comparison_text, held_text, lock_step_text, model_text


def test_each_program_has_its_line_in_microseconds(result: Callable[..., ProgramResult]) -> None:
    text = comparison_text({Contestant.OURS: result(123.4, 5.6), Contestant.BARE: result(1.0)})
    ours = next(line for line in text.splitlines() if line.startswith("  ours"))
    assert ours.split() == ["ours", *["123.4"] * 5, *["5.6"] * 4, "0", "0", "10000"]


def test_columns_are_aligned(result: Callable[..., ProgramResult]) -> None:
    lines = comparison_text({Contestant.OURS: result(12345.6), Contestant.USER: result(1.0)}).splitlines()
    head, ours, user = lines[1:4]
    assert len(head) == len(ours) == len(user)
    assert head.index("p50") + 3 == ours.index("12345.6", ours.index("12345.6") + 1) + 7


def test_shares_memory_and_start_are_reported_in_units_that_people_read(result: Callable[..., ProgramResult]) -> None:
    text = comparison_text({Contestant.OURS: result()})
    assert "4.0 %" in text
    assert "20 MB" in text
    assert "30 MB" in text
    assert "0.50 s" in text
    assert "20.0/20.0" in text  # the bus, p50/p99


def test_a_rate_that_was_not_tried_is_left_open_and_giving_up_is_reported(cycles: Callable[..., Cycles]) -> None:
    held = {
        Contestant.OURS: SustainedRates({100.0: cycles(), 200.0: cycles(late=3, lost=1)}, {200.0: "too late"}),
        Contestant.USER: SustainedRates({100.0: cycles(late=9)}, {}),
    }
    head, ours, user = held_text(held, 30.0).splitlines()[1:]
    assert head.split() == ["100", "Hz", "200", "Hz", "none", "late", "up", "to", "none", "lost", "up", "to"]
    assert ours.split() == ["ours", "0/0", "3/1", "gave", "up", "100", "Hz", "100", "Hz"]
    assert user.split() == ["user's", "loop", "9/0", "-", "0", "Hz", "100", "Hz"]


def test_lock_step_and_campaign_are_judged_by_what_is_wanted() -> None:
    slow, fast = LockStep("segway", 200.0, 10.0, 0.25), LockStep("segway", 200.0, 10.0, 0.2)
    assert "40 times real time, at least 50 wanted: NOT met" in lock_step_text([slow])
    assert "50 times real time, at least 50 wanted: met" in lock_step_text([fast])
    assert "wanted" not in lock_step_text([LockStep("cart-can", 100.0, 10.0, 0.1)])
    assert "10.0 runs a second, 2 at a time (20 runs of 500)" in campaign_text(CampaignSpeed(20, 500, 2, 2.0))
    assert campaign_text(CampaignSpeed(20, 500, 2, 2.0)).endswith(": met")
    assert campaign_text(CampaignSpeed(20, 500, 2, 2.5)).endswith("NOT met")


def test_the_model_is_one_line() -> None:
    cost = {
        "through_our_interface_s": 1.25e-6,
        "native_s": 0.25e-6,
        "load_first_s": 1.5,
        "load_from_cache_s": 0.02,
    }
    assert model_text(cost) == (
        "native model: a step costs 1.25 us through our interface and 0.25 us from C (medians); "
        "loaded in 1.50 s the first time and 20 ms from the cache"
    )
