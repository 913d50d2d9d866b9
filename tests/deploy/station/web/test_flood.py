# SPDX-License-Identifier: MIT
"""Ten thousand requests a second: refused and counted, while who sits there goes on seeing and commanding."""

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.deploy.station.web.limits import Limits, Rate
from tests.deploy.station.web.scripted_station import full_robot
from tests.deploy.station.web.serving import browser, command, receive, served

Tried = Callable[[str, str], None]
FLOOD = Path(__file__).with_name("flood.py")
PER_S, SECONDS = 10_000, 3.0
LIMITS = Limits(requests=Rate(10.0, 50))
"""Of which the flood sends too many also from a machine that is busy with something else."""


@pytest.mark.variants(1)
@pytest.mark.parametrize("address", ["127.0.0.2", "127.0.0.1"], ids=["of another address", "of the operator's own"])
def test_a_flood_is_refused_and_the_station_goes_on(address: str, tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, limits=LIMITS) as here,
            browser(here, "ann") as client,
            client.ws_connect("/socket") as socket,
        ):
            here.station.robots = [full_robot(f"/robot{number}") for number in range(20)]
            process = await asyncio.create_subprocess_exec(
                sys.executable, FLOOD, str(here.port), str(PER_S), str(SECONDS), address, stdout=asyncio.subprocess.PIPE
            )
            flood = asyncio.create_task(process.communicate())
            frames, replies, healthy = 0, 0, 0
            while not flood.done():
                await receive(socket, "fleet")
                frames += 1
                if frames % 5 == 0:
                    replies += 1
                    await socket.send_str(command(frames, "stop"))
                    assert (await receive(socket, "reply"))["id"] == frames
                    # From an address of its own: a new page from the flood's would have to wait.
                    async with browser(here, address="127.0.0.3") as other, other.get("/health") as answer:
                        healthy += answer.status == 200
            sent, connections, seconds = (await flood)[0].split()
            counts = here.refused()
            assert healthy == replies > 0
            assert frames >= SECONDS  # one a second at the very least, whatever else this machine does
            assert counts.get("connection rate", 0) + counts["request rate"] + counts.get("no session", 0) > 100
            assert counts["request rate"] > 0
            here.station.robots = []
            here.station.happen("calm again")
            assert (await receive(socket, "event"))["text"] == "calm again"
        rate, each = float(sent) / float(seconds), frames / float(seconds)
        whose = "the operator's own address" if address == "127.0.0.1" else "another address"
        outcome = f"{dict(counts)}; meanwhile {each:.0f} pictures/s, {replies} of {replies} stops and /health answered"
        tried(f"{rate:.0f} requests/s in {connections.decode()} connections from {whose} for {SECONDS:g} s", outcome)

    asyncio.run(scenario())
