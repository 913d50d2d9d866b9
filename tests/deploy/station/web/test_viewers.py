# SPDX-License-Identifier: MIT
"""A hundred browsers' worth of viewers of twenty robots."""

import asyncio
import sys
import time
from pathlib import Path

import msgspec
import pytest

from tests.deploy.station.web.scripted_station import full_robot
from tests.deploy.station.web.serving import Served, served

VIEWERS = Path(__file__).with_name("viewers.py")


async def _watch(here: Served, count: int, seconds: float) -> list[float]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, VIEWERS, str(here.port), str(count), str(seconds), stdout=asyncio.subprocess.PIPE
    )
    rates: list[float] = msgspec.json.decode((await process.communicate())[0])
    return rates


def test_every_viewer_is_shown_pictures(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here:
            rates = await _watch(here, 10, 1.0)
            assert len(rates) == 10
            assert min(rates) > 0

    asyncio.run(scenario())


@pytest.mark.proof
def test_a_hundred_viewers_of_twenty_robots_see_ten_pictures_a_second(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here:
            here.station.robots = [full_robot(f"/robot{number}") for number in range(20)]
            here.station.tick()
            size = len(msgspec.json.encode(here.station.fleet()))
            wall_s, cpu_s = time.monotonic(), time.process_time()
            rates = await _watch(here, 100, 20.0)
            share = (time.process_time() - cpu_s) / (time.monotonic() - wall_s)
            each = f"{min(rates):.1f} to {max(rates):.1f} pictures/s, mean {sum(rates) / len(rates):.1f}"
            sys.stdout.write(
                f"\n100 viewers of 20 robots, {size} bytes a picture: {each}; the station uses {share:.0%} of a core\n"
            )
            assert min(rates) >= 10.0
            assert not here.refused()

    asyncio.run(scenario())
