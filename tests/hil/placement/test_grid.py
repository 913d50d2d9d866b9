# SPDX-License-Identifier: MIT
"""The study as a whole: the plan, the search, and the same bits in one process or in two."""

import msgspec

from segway_ecc.hil.placement.grid import (
    CUT_NETWORK,
    NETWORKS,
    PARTITIONS_S,
    LimitSearch,
    Size,
    cells,
    conduct,
    find,
    quick,
    tasks,
    whole,
)
from segway_ecc.hil.placement.results import PLACEMENTS

MARGINS_S = {"segway": 0.0319, "segway-odrive": 0.0319}


def test_the_whole_grid_holds_every_placement_on_every_network() -> None:
    plan = whole(MARGINS_S)
    assert plan.placements == PLACEMENTS
    assert plan.networks == tuple(NETWORKS)
    # Set-points cross the network in four of the eight placements, and then in two ways.
    assert [len(list(cells(plan, name))) for name in plan.networks] == [12] * len(NETWORKS)
    assert all(
        each.placement.stamped or each.placement.sequence != each.placement.balance for each in cells(plan, "none")
    )
    assert len(tasks(plan)) == len(plan.searches) + 12 * len(PARTITIONS_S) + (12 + 8) * len(NETWORKS)


def test_the_delay_is_searched_on_both_robots_with_what_theory_gives() -> None:
    delays = {kind.robot: kind.theory for kind in whole(MARGINS_S).searches if kind.size is Size.DELAY}
    assert delays == MARGINS_S


def test_the_quick_plan_is_a_part_of_the_whole_one() -> None:
    plan, all_of_it = quick(MARGINS_S), whole(MARGINS_S)
    assert set(plan.networks) < set(all_of_it.networks)
    assert set(plan.placements) < set(all_of_it.placements)
    assert set(plan.searches) < set(all_of_it.searches)
    assert set(plan.partitions_s) < set(all_of_it.partitions_s)
    assert len(tasks(plan)) < 20


def test_partitions_are_made_on_a_network_of_the_grid() -> None:
    assert CUT_NETWORK in NETWORKS


def test_the_search_closes_in_on_the_limit() -> None:
    bound = find(LimitSearch(robot="segway", size=Size.PARTITION, theory=0.5), (1,), 0.2)
    assert (bound.tolerated, bound.lost, bound.theory, bound.unit) == (0.0, 0.128, 0.5, "s")
    assert bound.lost_by.startswith("the guard stopped the drives")


def test_one_process_finds_the_same_bits_as_two() -> None:
    plan = msgspec.structs.replace(
        quick(MARGINS_S), networks=("Wi-Fi",), placements=(PLACEMENTS[7],), searches=(), partitions_s=()
    )
    counts: list[tuple[int, int]] = []
    alone = conduct(plan, 1, lambda done, total: counts.append((done, total)))
    assert conduct(plan, 2, lambda _done, _total: None) == alone
    assert counts == [(1, 2), (2, 2)]
    assert [len(part) for part in (alone.drives, alone.stops, alone.cuts, alone.bounds)] == [1, 1, 0, 0]
    assert alone.drives[0].max_position_m > 0.0


def test_a_robot_that_does_not_arm_over_the_network_differs_from_one_that_shakes() -> None:
    bound = find(LimitSearch(robot="segway-odrive", size=Size.STANDING), (1,), 0.064)
    assert (bound.tolerated, bound.lost, bound.lost_by) == (0.0, 0.064, "it never arms")
