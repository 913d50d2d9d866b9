# SPDX-License-Identifier: MIT
"""The speed of what runs without a clock: robots in lock step, the campaign, a native model's step, and CAN links.

As a program, prints `links_cost` as JSON, for the kernel of a guest.
"""

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.links.can_ports import make_can_link, make_python_can_link
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.bench.rig import own_cache, virtual_interface
from segway_ecc.hil.campaign.both_plants import sampled
from segway_ecc.hil.campaign.run import run_campaign, runs_of
from segway_ecc.hil.campaign.scenario import load_all
from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.case_study.seats import SUBMODEL_CART
from segway_ecc.hil.endurance.endurance import drive
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import compile_c
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.native.load import load_native
from segway_ecc.node.robot import build_robot
from segway_ecc.node.sequence.manoeuvre import single_segment

_LINK_CYCLES: Final = 500
_LINK_WARM_UP: Final = 20
_IN: Final = [Frame(0x120 + number, bytes(range(8))) for number in range(4)]
_OUT: Final = [Frame(0x110 + number, bytes(range(8))) for number in range(2)]
_BITRATE: Final = 500_000
_STEPS: Final = 20_000
_REPETITIONS: Final = 3
_CART: Final = "cart-can"
_SEGWAY: Final = "segway"
_DRIVEN_S: Final = 10.0
CAMPAIGN_WANTED: Final = 10.0
"""Runs a second on two cores: what a campaign is to be."""
_SAMPLE: Final = 96
SEGWAY_WANTED: Final = 50.0
"""Times real time: what the segway's lock step is to be."""


@dataclass(frozen=True, slots=True)
class LockStep:
    """A robot in lock step on the simulated bus, without a log: how long it drove in its own time, and in ours."""

    robot: str
    rate_hz: float
    simulated_s: float
    median_s: float

    @property
    def times_real_time(self) -> float:
        """How much faster than real time."""
        return self.simulated_s / self.median_s


def lock_step() -> list[LockStep]:
    """Drive the cart through a cell of the case study, and the segway through its street, several times each."""
    seat, manoeuvre = LockstepCanSeat(None, _CART), single_segment(2.0, 2.0, _DRIVEN_S)
    segway = load_robot(_SEGWAY)
    return [
        _lock_step(_CART, lambda: seat.run("bench", manoeuvre)),
        _lock_step(_SEGWAY, lambda: drive(segway, 0, _DRIVEN_S, 0.0)),
    ]


def _lock_step(robot: str, run: Callable[[], object]) -> LockStep:
    rate_hz = 1e9 / build_robot(load_robot(robot), RealClock()).period_ns
    return LockStep(robot, rate_hz, _DRIVEN_S, statistics.median(_took_s(run) for _ in range(_REPETITIONS)))


def _took_s(run: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    run()
    return time.perf_counter() - began_s


@dataclass(frozen=True, slots=True)
class CampaignSpeed:
    """A part of the campaign, evenly chosen, `of` all its runs, on so many processes; how long it took, all in all."""

    runs: int
    of: int
    jobs: int
    took_s: float

    @property
    def runs_per_s(self) -> float:
        """Runs a second."""
        return self.runs / self.took_s


def campaign_speed() -> CampaignSpeed:
    """Run a part of the campaign on all cores, from the start of their processes to the last result."""
    trials = runs_of(list(load_all([])))
    chosen, jobs = sampled(trials, _SAMPLE), len(os.sched_getaffinity(0))
    took_s = _took_s(lambda: run_campaign(chosen, jobs, lambda _done, _all: None))
    return CampaignSpeed(len(chosen), len(trials), jobs, took_s)


def model_step() -> dict[str, float]:
    """Durations, s: of loading it the first time and from the cache, and of a step either way (medians)."""
    source = Path(SUBMODEL_CART.source)
    with own_cache():
        first_s, again_s = (_took_s(lambda: load_native(source)) for _ in range(2))
        return {"load_first_s": first_s, "load_from_cache_s": again_s, **step_cost(load_native(source))}


def step_cost(model: NativeModel) -> dict[str, float]:
    """Measure a step through our interface and called from C, of a model whose library stands alone.

    Returns:
        `through_our_interface_s` and `native_s`: medians over many steps, each with the cost of reading the clock, s.

    Raises:
        ModelError: The C side cannot be compiled or run.
    """
    u = [v.value for v in model.inputs]
    model.initialize(u)
    durations = []
    for _ in range(_STEPS):
        start = time.perf_counter_ns()
        model.step(u)
        durations.append(time.perf_counter_ns() - start)
    source = Path(__file__).with_name("native_cost.c").read_bytes()
    with tempfile.TemporaryDirectory(prefix="segway-ecc-cost-") as name:
        program = str(Path(name) / "native_cost")
        compile_c(["-O2", "-x", "c", "-", "-o", program, "-ldl"], "native_cost.c", source)
        ports = (str(len(model.inputs)), str(len(model.outputs)), str(_STEPS))
        try:
            words = [program, str(model.library_path), *ports]
            native_ns = int(subprocess.check_output(words, stderr=subprocess.DEVNULL))  # noqa: S603 - our own program
        except (OSError, subprocess.CalledProcessError) as error:
            raise ModelError(f"cannot measure model '{model.name}' from C: {error}") from error
    return {"through_our_interface_s": statistics.median(durations) * 1e-9, "native_s": native_ns * 1e-9}


def links_cost() -> dict[str, float] | None:
    """Time a cycle of four frames in and two out through python-can and through a raw socket, in turns.

    Only on a virtual interface: what is sent here would reach the motors of a real one. Returns the median of each, us,
    and how many times the raw socket is faster; None where there is no virtual interface that is up.
    """
    channel = virtual_interface()
    if channel is None:
        return None
    with (
        contextlib.closing(make_can_link("socketcan", channel, _BITRATE)) as feeder,
        contextlib.closing(make_python_can_link("socketcan", channel, _BITRATE)) as python_can,
        contextlib.closing(make_can_link("socketcan", channel, _BITRATE)) as raw,
    ):
        for each in (feeder, python_can, raw):
            each.open()
        links: dict[str, Link] = {"python_can_us": python_can, "raw_us": raw}
        costs: dict[str, list[float]] = {name: [] for name in links}
        for cycle in range(_LINK_WARM_UP + _LINK_CYCLES):
            for name, link in links.items():
                cost_us = _cycle_us(link, feeder, [other for other in links.values() if other is not link])
                if cycle >= _LINK_WARM_UP:
                    costs[name].append(cost_us)
    medians = {name: statistics.median(values) for name, values in costs.items()}
    return {**medians, "ratio": medians["python_can_us"] / medians["raw_us"]}


def _cycle_us(link: Link, feeder: Link, others: list[Link]) -> float:
    """One cycle of `link`; the other participants take no time from it."""
    for frame in _IN:
        feeder.send(frame)
    start_ns = time.perf_counter_ns()
    received = link.receive()
    for frame in _OUT:
        link.send(frame)
    end_ns = time.perf_counter_ns()
    if len(received) < len(_IN):
        raise RuntimeError(f"{len(received)} of {len(_IN)} frames arrived on {link.description}")
    for other in (feeder, *others):
        other.receive()
    return (end_ns - start_ns) / 1e3


if __name__ == "__main__":
    sys.stdout.write(json.dumps(links_cost()) + "\n")
