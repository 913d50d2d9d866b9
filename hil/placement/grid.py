# SPDX-License-Identifier: MIT
"""The placement study: networks, placements, what is run on each, and all of it side by side on the cores."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Final

import msgspec

from segway_ecc.hil.parallel import results_of
from segway_ecc.hil.placement.cells import Setting, cut, drive, stop
from segway_ecc.hil.placement.network import Delivery, Network
from segway_ecc.hil.placement.placement import PLACEMENTS, Placement
from segway_ecc.hil.placement.results import Bound, Cut, Drive, Stop, StudyResult
from segway_ecc.hil.placement.search import LimitSearch, Size, find
from segway_ecc.hil.progress import OnProgress

ROBOT: Final = "segway"
TORQUE_ROBOT: Final = "segway-odrive"

NETWORKS: Final[Mapping[str, Network]] = {
    "none": Network(),
    "wired": Network(latency_s=0.0005, jitter_s=0.0002),
    "Wi-Fi": Network(latency_s=0.005, jitter_s=0.004, loss=0.01),
    "10 ms": Network(latency_s=0.010),
    "20 ms": Network(latency_s=0.020),
    "50 ms": Network(latency_s=0.050),
    "200 ms": Network(latency_s=0.200),
    "loss 5 %": Network(latency_s=0.005, loss=0.05),
    "5 %, late": Network(latency_s=0.005, loss=0.05, repeats_s=3.0),
    "loss 20 %": Network(latency_s=0.005, loss=0.20),
    "mobile": Network(latency_s=0.080, jitter_s=0.040, loss=0.02),
    "bad": Network(latency_s=0.150, jitter_s=0.140, loss=0.20),
}
"""Latency is one way; jitter is the largest deviation from it.

3 s is the heartbeat period of Fast DDS, at which what was lost is missed at the latest.
"""
CUT_NETWORK: Final = "wired"
"""On which the partitions are made: what comes of one shows best on a network that is good otherwise."""
PARTITIONS_S: Final = (0.1, 0.3, 2.0, 12.0, 18.0)
SEEDS: Final = (1, 2, 3)
SEARCH_SEEDS: Final = (1, 2)

_QUICK_NETWORKS: Final = ("50 ms",)
_QUICK_PARTITIONS_S: Final = (0.3,)
_QUICK_RESOLUTION: Final = 0.032


class StudyPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is run.

    Attributes:
        networks: Names of the networks.
        placements: The placements.
        partitions_s: Lengths of the partitions, s.
        seeds: With which each stop is pressed.
        searches: What is searched for.
        search_seeds: With which it must be tolerated.
        resolution: How closely, in the unit of what is searched for; None for the resolution of each kind.
    """

    networks: tuple[str, ...]
    placements: tuple[Placement, ...]
    partitions_s: tuple[float, ...]
    seeds: tuple[int, ...]
    searches: tuple[LimitSearch, ...]
    search_seeds: tuple[int, ...]
    resolution: float | None = None


Task = Callable[[], Drive | Stop | Cut | Bound]


def whole(margins_s: Mapping[str, float]) -> StudyPlan:
    """The whole grid; `margins_s` are the delay margins by design, s, by robot."""
    return StudyPlan(
        networks=tuple(NETWORKS),
        placements=PLACEMENTS,
        partitions_s=PARTITIONS_S,
        seeds=SEEDS,
        searches=tuple(_searches(margins_s)),
        search_seeds=SEARCH_SEEDS,
    )


def quick(margins_s: Mapping[str, float]) -> StudyPlan:
    """A few cells of it: enough to see that the study works."""
    return StudyPlan(
        networks=_QUICK_NETWORKS,
        placements=(PLACEMENTS[0], PLACEMENTS[5], PLACEMENTS[7]),
        partitions_s=_QUICK_PARTITIONS_S,
        seeds=SEEDS[:1],
        searches=(LimitSearch(robot=ROBOT, size=Size.DELAY, theory=margins_s.get(ROBOT)),),
        search_seeds=SEARCH_SEEDS[:1],
        resolution=_QUICK_RESOLUTION,
    )


def _searches(margins_s: Mapping[str, float]) -> Iterator[LimitSearch]:
    for robot in (ROBOT, TORQUE_ROBOT):
        yield LimitSearch(robot=robot, size=Size.DELAY, theory=margins_s.get(robot))
        yield LimitSearch(robot=robot, size=Size.STANDING)
    yield from (LimitSearch(robot=ROBOT, size=Size.JITTER, delivery=delivery) for delivery in Delivery)
    yield from (LimitSearch(robot=ROBOT, size=Size.LOSS, delivery=way) for way in (Delivery.NEWEST, Delivery.IN_ORDER))
    yield LimitSearch(robot=ROBOT, size=Size.PARTITION)


def tasks(plan: StudyPlan) -> list[Task]:
    """Everything that is run, what takes long first, so that no process is left alone with it."""
    found: list[Task] = [partial(find, kind, plan.search_seeds, plan.resolution) for kind in plan.searches]
    for partition_s in sorted(plan.partitions_s, reverse=True):
        found += [partial(cut, setting, partition_s) for setting in settings(plan, CUT_NETWORK)]
    for name in plan.networks:
        found += [partial(drive, setting) for setting in settings(plan, name)]
        found += [partial(stop, setting, plan.seeds) for setting in settings(plan, name) if setting.stamped]
    return found


def settings(plan: StudyPlan, name: str) -> Iterator[Setting]:
    """Every placement on a network; with set-points of both kinds where they cross it."""
    for placement in plan.placements:
        for stamped in (True, False) if placement.sequence_crosses else (True,):
            yield Setting(robot=ROBOT, placement=placement, name=name, network=NETWORKS[name], stamped=stamped)


def conduct(plan: StudyPlan, jobs: int, on_progress: OnProgress) -> StudyResult:
    """Run a plan; what is found is the same bits whatever `jobs` is.

    Args:
        plan: What to run.
        jobs: How many processes run at a time; 1 for this one alone.
        on_progress: Called after each task.
    """
    todo = tasks(plan)
    everything: list[Drive | Stop | Cut | Bound] = []
    with results_of(_call, todo, jobs) as results:
        for result in results:
            everything.append(result)
            on_progress(len(everything), len(todo))
    return StudyResult(
        drives=tuple(r for r in everything if isinstance(r, Drive)),
        stops=tuple(r for r in everything if isinstance(r, Stop)),
        cuts=tuple(r for r in everything if isinstance(r, Cut)),
        bounds=tuple(r for r in everything if isinstance(r, Bound)),
    )


def _call(task: Task) -> Drive | Stop | Cut | Bound:
    return task()
