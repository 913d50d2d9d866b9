# SPDX-License-Identifier: MIT
"""The placement study: networks and placements, what is run on each, and all of it side by side on the cores.

And by bisection how bad a network balance control on the station tolerates.
"""

import enum
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Final

import msgspec

from segway_ecc.hil.placement.bench import START_S, PlacementRun, run
from segway_ecc.hil.placement.judging import (
    UPRIGHT,
    Errors,
    RunOutcome,
    RunRecord,
    errors,
    outcome_of,
    reason_of,
    story,
)
from segway_ecc.hil.placement.network import PERFECT, Delivery, Network, Partition
from segway_ecc.hil.placement.results import (
    ON_THE_ROBOT,
    PLACEMENTS,
    STAMPED,
    UNSTAMPED,
    Bound,
    Cut,
    Drive,
    Placement,
    Row,
    Site,
    Stop,
    StudyResult,
)
from segway_ecc.hil.processes import results_of
from segway_ecc.hil.progress import OnProgress
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

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

MANOEUVRE: Final = Manoeuvre(
    segments=(Segment(linear=0.5, duration=2.0), Segment(linear=0.5, angular=0.8, duration=2.0))
)
"""Ahead, then a curve, then rest."""
_REST_S: Final = 1.5
_CUT_AT_S: Final = START_S + 1.5
"""When a partition begins, s."""
_AFTER_CUT_S: Final = 3.0
_STOP_AT_S: Final = START_S + 1.5
_STOP_EVERY_S: Final = 0.0237
"""How much later each further seed presses: anywhere in a cycle, and between heartbeats."""
_STOPPED_WITHIN_S: Final = 2.5
AWAY: Final = Placement(sequence=Site.ROBOT, balance=Site.STATION, supervision=Site.ROBOT)
NUDGE_N: Final = 10.0
"""For 0.1 s: as `segway-ecc design margins` nudges."""
_AT_REST: Final = Manoeuvre(segments=(Segment(duration=1.0),))
_BEGINS_S: Final = START_S - 1.0
_GROWS_S: Final = 1.8
"""It grows to its size before the nudge, so that no gap between messages looks like a lost bus."""
_SEARCH_CUT_AT_S: Final = START_S + 3.0
_UNTIL_S: Final = START_S + 7.0
_remembered_run: Final = lru_cache(maxsize=16)(run)
"""For the references, runs with everything on the robot, which many cells share."""


@enum.unique
class Size(enum.Enum):
    """What is made larger; each with its unit, the largest tried and how closely the limit is found."""

    DELAY = ("delay there and back, together", "s", 0.128, 0.001)
    STANDING = ("delay there and back, together, from before it stands up", "s", 0.128, 0.001)
    JITTER = ("jitter", "s", 0.032, 0.00025)
    LOSS = ("loss, each way", "1", 0.64, 0.005)
    PARTITION = ("partition", "s", 0.256, 0.001)


_ORDERED: Final = (Size.JITTER, Size.LOSS)
"""Where it matters what becomes of messages that are lost or overtaken."""


class LimitSearch(msgspec.Struct, frozen=True, kw_only=True):
    """What is made larger, what becomes of messages lost or overtaken, and the limit by theory, None where unknown."""

    robot: str
    size: Size
    delivery: Delivery = Delivery.NEWEST
    theory: float | None = None


def find(search: LimitSearch, seeds: Sequence[int], resolution: float | None = None) -> Bound:
    """The most that is tolerated, by bisection: less than what is tolerated is taken to be tolerated too."""
    what, unit, most, finest = search.size.value

    def lost_with(size: float) -> str | None:
        job = PlacementRun(
            robot=search.robot,
            placement=AWAY,
            manoeuvre=_AT_REST,
            until_s=_UNTIL_S,
            network=_network(search, size),
            pushed_n=NUDGE_N,
            delivery=search.delivery,
            until_fallen=True,
        )
        return _lost_by([run(msgspec.structs.replace(job, seed=seed)) for seed in seeds])

    tolerated, lost, lost_by = 0.0, most, lost_with(most)
    if lost_by is None:
        tolerated = most
    while lost - tolerated > (resolution or finest):
        middle = 0.5 * (tolerated + lost)
        by = lost_with(middle)
        if by is None:
            tolerated = middle
        else:
            lost, lost_by = middle, by
    return Bound(
        robot=search.robot,
        what=f"{what}, {search.delivery}" if search.size in _ORDERED else what,
        unit=unit,
        tolerated=tolerated,
        lost=None if lost_by is None else lost,
        lost_by=lost_by or "",
        theory=search.theory,
    )


def _lost_by(runs: Sequence[RunRecord]) -> str | None:
    """Why balance was lost in the first run in which it was; None where in none."""
    for seen in runs:
        if seen.fell_s(START_S) is not None or not seen.is_calm_at_the_end:
            return reason_of(seen) or ("it shakes" if seen.changes else "it never arms")
    return None


def _network(search: LimitSearch, size: float) -> Network:
    growing = Network(begins_s=_BEGINS_S, grows_s=_GROWS_S)
    match search.size:
        case Size.DELAY:
            return msgspec.structs.replace(growing, latency_s=0.5 * size)
        case Size.STANDING:
            return Network(latency_s=0.5 * size)
        case Size.JITTER:
            # around as much latency as itself
            return msgspec.structs.replace(growing, latency_s=size, jitter_s=size)
        case Size.LOSS:
            return msgspec.structs.replace(growing, loss=size)
        case Size.PARTITION:
            return msgspec.structs.replace(growing, partitions=(Partition(_SEARCH_CUT_AT_S, size),))


class StudyPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is run.

    Attributes:
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


Found = Drive | Stop | Cut | Bound
Task = Callable[[], Found]


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
        networks=("50 ms",),
        placements=(PLACEMENTS[0], PLACEMENTS[5], PLACEMENTS[7]),
        partitions_s=(0.3,),
        seeds=SEEDS[:1],
        searches=(LimitSearch(robot=ROBOT, size=Size.DELAY, theory=margins_s.get(ROBOT)),),
        search_seeds=SEARCH_SEEDS[:1],
        resolution=0.032,
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
        found += [partial(cut, cell, partition_s) for cell in cells(plan, CUT_NETWORK)]
    for name in plan.networks:
        found += [partial(drive, cell) for cell in cells(plan, name)]
        found += [partial(stop, cell, plan.seeds) for cell in cells(plan, name) if cell.placement.stamped]
    return found


def cells(plan: StudyPlan, network: str) -> Iterator[Row]:
    """Every placement on a network; with set-points of both kinds where they cross it."""
    for placement in plan.placements:
        for setpoints in (STAMPED, UNSTAMPED) if placement.sequence_crosses else ("",):
            yield Row(**placement._replace(setpoints=setpoints)._asdict(), network=network)


def conduct(plan: StudyPlan, jobs: int, on_progress: OnProgress) -> StudyResult:
    """Run a plan; what is found is the same bits whatever `jobs` is.

    So many processes run at a time, 1 for this one alone; `on_progress` is called after each task.
    """
    todo = tasks(plan)
    everything: list[Found] = []
    with results_of(operator.call, todo, jobs) as results:
        for result in results:
            everything.append(result)
            on_progress(len(everything), len(todo))
    return StudyResult(
        drives=tuple(r for r in everything if isinstance(r, Drive)),
        stops=tuple(r for r in everything if isinstance(r, Stop)),
        cuts=tuple(r for r in everything if isinstance(r, Cut)),
        bounds=tuple(r for r in everything if isinstance(r, Bound)),
    )


def drive(cell: Row) -> Drive:
    """Drive the manoeuvre."""
    job = _job(cell, MANOEUVRE, START_S + MANOEUVRE.duration_ns * 1e-9 + _REST_S)
    seen, apart = _against_reference(job)
    return Drive(
        **msgspec.structs.asdict(cell),
        outcome=outcome_of(seen, START_S),
        reason=reason_of(seen),
        **apart._asdict(),
        max_tilt_rad=seen.max_tilt(START_S),
        digest=seen.digest,
    )


def stop(cell: Row, seeds: Sequence[int]) -> Stop:
    """Press stop while it drives, once for each seed."""
    times, outcomes = [], []
    for place, seed in enumerate(seeds):
        pressed_s = _STOP_AT_S + place * _STOP_EVERY_S
        job = _job(cell, MANOEUVRE, pressed_s + _STOPPED_WITHIN_S)
        seen = run(msgspec.structs.replace(job, seed=seed, stop_at_s=pressed_s))
        before = seen._replace(
            truth=[at for at in seen.truth if at.time < pressed_s],
            changes=[change for change in seen.changes if change.at_ns < pressed_s * 1e9],
            postures=[posture for posture in seen.postures if posture[0] < pressed_s],
        )
        outcome = outcome_of(before, START_S)
        outcomes.append(outcome)
        is_measured = outcome in UPRIGHT and seen.zero_s is not None
        times.append((seen.zero_s or 0.0) - pressed_s if is_measured else None)
    return Stop(**msgspec.structs.asdict(cell), zero_s=tuple(times), outcome=max(outcomes, key=list(RunOutcome).index))


def cut(cell: Row, partition_s: float) -> Cut:
    """Cut the network while it drives."""
    network = msgspec.structs.replace(NETWORKS[cell.network], partitions=(Partition(_CUT_AT_S, partition_s),))
    lasts_s = _CUT_AT_S - START_S + partition_s + _AFTER_CUT_S
    manoeuvre = Manoeuvre(segments=(Segment(linear=0.3, angular=0.4, duration=lasts_s),))
    job = msgspec.structs.replace(_job(cell, manoeuvre, START_S + lasts_s + _REST_S), network=network)
    seen, apart = _against_reference(job)
    return Cut(
        **msgspec.structs.asdict(cell),
        partition_s=partition_s,
        outcome=outcome_of(seen, START_S),
        did=story(seen, _CUT_AT_S),
        max_position_m=apart.max_position_m,
        max_tilt_rad=seen.max_tilt(START_S),
    )


def _job(cell: Row, manoeuvre: Manoeuvre, until_s: float) -> PlacementRun:
    return PlacementRun(
        robot=ROBOT,
        placement=cell.placement,
        network=NETWORKS[cell.network],
        manoeuvre=manoeuvre,
        until_s=until_s,
        stamped=cell.placement.stamped,
    )


def _against_reference(job: PlacementRun) -> tuple[RunRecord, Errors]:
    seen = run(job)
    reference = _remembered_run(msgspec.structs.replace(job, placement=ON_THE_ROBOT, network=PERFECT, stamped=True))
    return seen, errors(seen.since(START_S), reference.since(START_S))
