# SPDX-License-Identifier: MIT
"""What is seen at the far end of a slow link, and when: server and sockets are real, time is simulated."""

import asyncio
import contextlib
import statistics
import sys
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import aiohttp
import msgspec
import pytest

from tests.deploy.station.web.scripted_station import ScriptedStation, full_robot
from tests.deploy.station.web.serving import receive, served
from tests.deploy.station.web.simulated_time import run_simulated
from tests.deploy.station.web.slow_link import LinkQuality, slow_link

LAN: Final = LinkQuality(bytes_per_s=10e6, latency_s=0.001)
FAR: Final = LinkQuality(bytes_per_s=40e3, latency_s=0.1)
GAPPY: Final = FAR._replace(gap_s=2.0)
WATCHED_S: Final = 10.0
"""Long enough for a queue on the way to grow to many seconds, where there is one."""
TRIED: Final = 20
"""At so many moments, of other phases to the pictures, a robot goes into FAULT."""


class Sight(NamedTuple):
    """What the far end saw.

    Attributes:
        pictures_per_s: How many came, 1/s.
        ages_s: How old each was when it arrived, s.
        faults_s: How long after each FAULT it was seen, s.
    """

    pictures_per_s: float
    ages_s: Sequence[float]
    faults_s: Sequence[float]


@contextlib.asynccontextmanager
async def _far_end(
    folder: Path, quality: LinkQuality, count: int
) -> AsyncIterator[tuple[ScriptedStation, aiohttp.ClientWebSocketResponse]]:
    """A station of some robots, and a viewer's socket to it through a link."""
    loop = asyncio.get_running_loop()
    station = ScriptedStation([full_robot(f"/robot{number}") for number in range(count)], loop.time)
    async with (
        served(folder, station=station, clock_ns=lambda: round(loop.time() * 1e9)) as here,
        slow_link(quality, here.port) as port,
        aiohttp.ClientSession(headers={"Host": f"127.0.0.1:{here.port}", "Origin": here.url}) as client,
        client.ws_connect(f"http://127.0.0.1:{port}/socket?pictures=deflate", max_msg_size=0) as socket,
    ):
        yield station, socket


def _set_mode(station: ScriptedStation, mode: str) -> None:
    station.robots = [msgspec.structs.replace(station.robots[0], mode=mode), *station.robots[1:]]


async def _watch(folder: Path, quality: LinkQuality, count: int) -> Sight:
    loop = asyncio.get_running_loop()
    ages: list[float] = []
    begun: list[float] = []
    seen: list[float] = []
    async with _far_end(folder, quality, count) as (station, socket):

        def fail() -> None:
            begun.append(loop.time())
            _set_mode(station, "FAULT")

        loop.call_at(WATCHED_S, fail)
        is_next_due = False
        while len(seen) < TRIED:
            picture = await receive(socket, "fleet")
            ages.append(loop.time() - picture["time_s"])
            is_fault = picture["robots"][0]["mode"] == "FAULT"
            if is_fault and len(seen) < len(begun):
                seen.append(loop.time() - begun[-1])
                _set_mode(station, "ARMED")
                is_next_due = True
            elif is_next_due and not is_fault:
                loop.call_later(1.0 + 0.037 * len(seen), fail)
                is_next_due = False
        return Sight(len(ages) / loop.time(), ages, seen)


def _sight(folder: Path, quality: LinkQuality, count: int) -> Sight:
    sight = run_simulated(_watch(folder, quality, count))
    gap = f", {quality.gap_s:g} s of each {quality.period_s:g} s nothing" if quality.gap_s else ""
    sys.stderr.write(
        f"\n| {quality.bytes_per_s / 1e3:g} kB/s, {quality.latency_s * 1e3:g} ms{gap} | {count} | "
        f"{sight.pictures_per_s:.1f} | {_median(sight.ages_s):.0f}, {max(sight.ages_s) * 1e3:.0f} | "
        f"{_median(sight.faults_s):.0f}, {max(sight.faults_s) * 1e3:.0f} |\n"
    )
    return sight


def _median(times_s: Sequence[float]) -> float:
    """In ms."""
    return 1e3 * statistics.median(times_s)


def test_the_link_is_as_slow_as_it_says(tmp_path: Path) -> None:
    async def fetch() -> tuple[int, float]:
        loop = asyncio.get_running_loop()
        station = ScriptedStation(clock=loop.time)
        async with (
            served(tmp_path, station=station, clock_ns=lambda: round(loop.time() * 1e9)) as here,
            slow_link(FAR, here.port) as port,
            aiohttp.ClientSession(headers={"Host": f"127.0.0.1:{here.port}"}) as client,
        ):
            begun_s = loop.time()
            async with client.get(f"http://127.0.0.1:{port}/static/vendor/uplot.js") as answer:
                return len(await answer.read()), loop.time() - begun_s

    size, took_s = run_simulated(fetch())
    least_s = size / FAR.bytes_per_s + 2.0 * FAR.latency_s
    assert least_s <= took_s <= least_s + 0.1


@pytest.mark.parametrize("count", [1, 20])
def test_a_fault_is_seen_within_a_second_at_40_kb_per_s_and_100_ms(tmp_path: Path, count: int) -> None:
    sight = _sight(tmp_path, FAR, count)
    assert max(sight.faults_s) <= 1.0
    assert max(sight.ages_s) <= 0.5, "fewer pictures, not older ones"
    assert sight.pictures_per_s >= 2.0


def test_a_quick_link_gets_every_picture(tmp_path: Path) -> None:
    sight = _sight(tmp_path, LAN, 5)
    assert sight.pictures_per_s >= 19.0
    assert max(sight.faults_s) <= 0.1


def test_after_a_gap_the_newest_comes_next(tmp_path: Path) -> None:
    """What was on the way is as old as the gap is long; nothing else is."""
    sight = _sight(tmp_path, GAPPY, 5)
    assert max(sight.faults_s) <= GAPPY.gap_s + 1.0
    late = [index for index, age_s in enumerate(sight.ages_s) if age_s > 0.5]
    assert late, "some were in a gap"
    assert max(sight.ages_s) <= GAPPY.gap_s + 0.5
    runs = sum(1 for index in late if index - 1 not in late)
    assert len(late) <= 2 * runs, "no more than were on the way"
