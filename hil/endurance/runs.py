# SPDX-License-Identifier: MIT
"""Many hours of driving, divided over seeds and cores; a robot that has tripped is started anew."""

from collections.abc import Sequence
from multiprocessing.sharedctypes import SynchronizedArray
from typing import Final, NamedTuple

from segway_ecc.hil.endurance.endurance import Stretch, drive
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.parallel import ignore_interrupt, quiet, spawning
from segway_ecc.hil.progress import OnSeconds
from segway_ecc.node.config import RobotFile

_REPORTED_EVERY_S: Final = 0.5
_MOST_TRIPS: Final = 20
"""Trips of one seed, after which it drives no more: what fails so often needs no more proof."""


class EndurancePlan(NamedTuple):
    """What is to be driven.

    Attributes:
        duration_s: How long, of all seeds together, s.
        frame_loss: Share of the frames that is lost either way.
        seeds: Seeds 1 to this, each of which has its share of the time.
        channel: The CAN interface of robot and plant; None for a simulated bus. On one the seeds take turns.
    """

    file: RobotFile
    duration_s: float
    frame_loss: float
    seeds: int
    faults: Sequence[Fault] = ()
    channel: str | None = None


def endure(plan: EndurancePlan, jobs: int, on_progress: OnSeconds) -> list[Stretch]:
    """Drive what is planned; the stretches are in the order of the seeds, and the same whatever `jobs` is.

    Raises:
        ConfigurationError: The robot cannot be simulated.
    """
    seeds = range(1, plan.seeds + 1)
    if jobs == 1 or plan.channel is not None:
        stretches: list[Stretch] = []
        for seed in seeds:
            before_s = sum(stretch.simulated_s for stretch in stretches)
            stretches += drive_seed(plan, seed, lambda time_s, before_s=before_s: on_progress(before_s + time_s))  # type: ignore[misc]
        return stretches
    with spawning() as processes:
        driven_s = processes.Array("d", plan.seeds)
        with processes.Pool(jobs, _start, (driven_s,)) as pool:
            ends = [pool.apply_async(_drive_in_pool, (plan, seed)) for seed in seeds]
            for end in ends:
                while not end.ready():
                    end.wait(_REPORTED_EVERY_S)
                    on_progress(sum(driven_s[:]))
            return [stretch for end in ends for stretch in end.get()]


def drive_seed(plan: EndurancePlan, seed: int, on_progress: OnSeconds) -> list[Stretch]:
    """Drive the share of one seed; after each trip a new robot, of another seed, drives on."""
    left_s, stretches = plan.duration_s / plan.seeds, list[Stretch]()
    while left_s > 0.0 and sum(stretch.trip is not None for stretch in stretches) < _MOST_TRIPS:
        before_s = plan.duration_s / plan.seeds - left_s
        with quiet("segway_ecc.node"):
            stretch = drive(
                plan.file,
                seed + plan.seeds * len(stretches),
                left_s,
                plan.frame_loss,
                faults=plan.faults,
                channel=plan.channel,
                on_progress=lambda time_s, before_s=before_s: on_progress(before_s + time_s),  # type: ignore[misc]
            )
        stretches.append(stretch)
        left_s = left_s - stretch.simulated_s if stretch.trip else 0.0
    on_progress(sum(stretch.simulated_s for stretch in stretches))
    return stretches


_driven_s: "SynchronizedArray[float] | None" = None
"""In a process of the pool: how far each seed has come, s."""


def _start(driven_s: "SynchronizedArray[float]") -> None:
    global _driven_s  # noqa: PLW0603 - the one way in which a pool hands shared memory to its processes
    _driven_s = driven_s
    ignore_interrupt()


def _drive_in_pool(plan: EndurancePlan, seed: int) -> list[Stretch]:
    def report(time_s: float) -> None:
        if _driven_s is not None:
            _driven_s[seed - 1] = time_s

    return drive_seed(plan, seed, report)
