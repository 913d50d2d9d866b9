# SPDX-License-Identifier: MIT
"""A hundred viewers and twenty robots on one station: do the viewers see enough, and are the robots disturbed?

Five robots are real (`segway-ecc run cart`), fifteen speak as robots do and compute nothing; all on this machine.
"""

import asyncio
import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import aiohttp
import pytest

from segway_ecc.hil.processes import command
from tests.deploy.station.whole_stack import Stack, ros_of_our_own

pytestmark = [pytest.mark.proof, pytest.mark.ros]

REAL: Final = 5
FAKE: Final = 15
VIEWERS: Final = 100
ROUNDS: Final = 3
LOOKS_S: Final = 40.0
RUNS_S: Final = 30.0
TESTS: Final = Path(__file__).parents[1]
VIEWER: Final = TESTS / "deploy" / "station" / "web" / "viewers.py"
FAKE_ROBOT: Final = TESTS / "deploy" / "station" / "fake_robot.py"
COLUMNS: Final = ("p50", "p99", "p999", "max")
_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


class Phase(NamedTuple):
    """What one time of running the real robots gave; the viewers' pictures per second, where there were any."""

    name: str
    robots: Sequence[Mapping[str, Any]]
    pictures: Sequence[float]
    picture_bytes: int
    cores: Mapping[str, float]
    load: float


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with ros_of_our_own(tmp_path):
        stack = Stack(tmp_path, "cart")
        try:
            stack.start_station()
            yield stack
        finally:
            stack.close()


@contextlib.contextmanager
def python(script: Path, *words: str) -> "Iterator[subprocess.Popen[bytes]]":
    environment = {**os.environ, "PYTHONPATH": str(TESTS.parent)}
    words = (sys.executable, str(script), *words)
    with subprocess.Popen(words, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


def cpu_s(pid: int) -> float:
    """What a process has used so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


async def see_all(port: int) -> int:
    """Wait for a picture with all robots alive; its length, bytes."""
    url = f"http://127.0.0.1:{port}"
    async with (
        asyncio.timeout(20.0),
        aiohttp.ClientSession(url, headers={"Origin": url}) as client,
        client.get("/session"),
        client.ws_connect("/socket", max_msg_size=0) as socket,
    ):
        while True:
            message = await socket.receive_str()
            picture = json.loads(message)
            if picture["kind"] != "fleet":
                continue
            await socket.send_json({"kind": "seen", "time_s": picture["time_s"]})
            if sum(robot["is_alive"] and bool(robot["timing"]) for robot in picture["robots"]) == REAL + FAKE:
                return len(message)


def run_the_real_ones(stack: Stack) -> tuple[list[Mapping[str, Any]], int]:
    """What they report, and how large a picture of all was."""
    with contextlib.ExitStack() as running:
        words = ["run", "cart", "--ros", "--no-log", "--json", "--duration", str(RUNS_S), "--namespace"]
        started = [
            running.enter_context(command([*words, f"/real{number}"], stack.folder / f"real{number}.txt"))
            for number in range(REAL)
        ]
        picture_bytes = asyncio.run(see_all(stack.port))
        return [each.result(RUNS_S + 60.0) for each in started], picture_bytes


def phase(stack: Stack, fakes: int, *, viewers: int) -> Phase:
    """Run the real robots with so many viewers, who look from before they start until after they ended."""
    pids = {"station": stack.pid("station"), "fifteen robots that are not real": fakes}
    with contextlib.ExitStack() as running:
        looking = None
        if viewers:
            looking = running.enter_context(python(VIEWER, str(stack.port), str(viewers), str(LOOKS_S)))
            pids["viewers"] = looking.pid
            time.sleep(3.0)  # they come in
        before, begun_s = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
        robots, picture_bytes = run_the_real_ones(stack)
        cores = {name: (cpu_s(pid) - before[name]) / (time.monotonic() - begun_s) for name, pid in pids.items()}
        load = os.getloadavg()[0]
        pictures = json.loads(looking.communicate(timeout=LOOKS_S + 60.0)[0]) if looking else []
    return Phase(f"{viewers or 'no'} viewers", robots, pictures, picture_bytes, cores, load)


def table(phases: Sequence[Phase]) -> str:
    rows = [f"{REAL} real robots at 100 Hz, us, lowest to highest of them: {', '.join(COLUMNS)}; late of all cycles"]
    for one in phases:
        rows += [f"{one.name:<12} {what:<9} {spans(one, what)}" for what in ("lateness", "cycle")]
        late, cycles = (sum(robot[name] for robot in one.robots) for name in ("late", "cycles"))
        rows.append(f"{one.name:<12} {late} of {cycles} cycles began late, load {one.load:.1f}")
        rows.append(f"{one.name:<12} cores used: {', '.join(f'{name} {used:.2f}' for name, used in one.cores.items())}")
        if one.pictures:
            mean = sum(one.pictures) / len(one.pictures)
            range_ = f"{min(one.pictures):.1f} to {max(one.pictures):.1f}"
            rows.append(f"{one.name:<12} {range_} pictures/s, mean {mean:.1f}, {one.picture_bytes} bytes each")
    return "\n".join(rows) + "\n"


def spans(one: Phase, what: str) -> str:
    found = [[robot["timing"][what][f"{column}_s"] * 1e6 for robot in one.robots] for column in COLUMNS]
    return "  ".join(f"{min(each):6.0f} to {max(each):6.0f}" for each in found)


def test_a_hundred_viewers_of_twenty_robots(stack: Stack) -> None:
    """Printed, since it depends on the machine; asserted is what the viewers must see."""
    phases = []
    with python(FAKE_ROBOT, *(f"/fake{number:02d}" for number in range(FAKE))) as fakes:
        for _ in range(ROUNDS):
            phases += [phase(stack, fakes.pid, viewers=viewers) for viewers in (0, VIEWERS)]
    sys.stderr.write(table(phases))
    for one in phases:
        assert all(robot["cycles"] == RUNS_S * 100 for robot in one.robots)
    seen = [each for one in phases for each in one.pictures]
    assert len(seen) == ROUNDS * VIEWERS
    assert min(seen) >= 10.0
