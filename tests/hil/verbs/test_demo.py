# SPDX-License-Identifier: MIT
"""`segway-ecc demo`: robot, guard and station from one command, seen by a client of the page's socket."""

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tests.patience import PATIENCE_S

Run = Callable[..., Any]
WAYS = [
    pytest.param("--ros", marks=[pytest.mark.ros, pytest.mark.real_time]),
    "--no-ros",  # in lock step, so that nothing beside it matters
]


class Shown:
    """The command, and the address that it prints."""

    def __init__(self, folder: Path, way: str) -> None:
        self._messages = folder / "messages.txt"
        with self._messages.open("wb") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "demo", "--port", "0", "--no-browser", way],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
                env={**os.environ, "TMPDIR": str(folder)},
            )

    def messages(self) -> str:
        return self._messages.read_text("utf-8")

    def port(self) -> int:
        deadline = time.monotonic() + PATIENCE_S
        while (found := re.search(r"open http://127\.0\.0\.1:(\d+)/; Ctrl-C", self.messages())) is None:
            assert self.process.poll() is None, self.messages()
            assert time.monotonic() < deadline, self.messages()
            time.sleep(0.05)
        return int(found[1])

    def end(self) -> int:
        """Ctrl-C, and the exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(PATIENCE_S)


@pytest.fixture(params=WAYS)
def shown(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Shown]:
    made = Shown(tmp_path, request.param)
    yield made
    if made.process.poll() is None:
        os.killpg(made.process.pid, signal.SIGKILL)
        made.process.wait()


class Client:
    """Whoever has the page open."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._count = 0

    async def message(self, is_wanted: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                found: dict[str, Any] = json.loads(await self._socket.receive_str())
                if found["kind"] == "fleet":
                    await self._socket.send_json({"kind": "seen", "time_s": found["time_s"]})
                if is_wanted(found):
                    return found

    async def posture(self, wanted: str) -> None:
        await self.message(lambda m: m["kind"] == "fleet" and any(robot["posture"] == wanted for robot in m["robots"]))

    async def attempt(self, name: str) -> str:
        self._count += 1
        ours = {"id": self._count, "kind": "command", "robot": "/", "act": "try", "name": name}
        await self._socket.send_json(ours)
        reply = await self.message(lambda m: m["kind"] == "reply" and m["id"] == ours["id"])
        assert reply["is_accepted"], reply
        return str(reply["text"])


def test_it_stands_is_pushed_broken_and_brought_back(shown: Shown) -> None:
    async def visit() -> list[str]:
        port = shown.port()
        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(cookie_jar=jar, base_url=f"http://127.0.0.1:{port}") as session:
            async with session.get("/session") as response:
                assert response.status == 200
            async with session.ws_connect("/socket", origin=f"http://127.0.0.1:{port}") as socket:
                client = Client(socket)
                hello = await client.message(lambda m: m["kind"] == "hello")
                assert "recover" in [trial["name"] for trial in hello["trials"]]
                await client.posture("BALANCING")
                return [await client.attempt(name) for name in ("push", "cut", "recover", "kill-node", "recover")]

    pushed, cut, back, killed, again = asyncio.run(visit())
    assert pushed.startswith("it drives on, and leaned by")
    assert re.fullmatch(r"zero torque after \d+ ms; FAULT FALLEN: .+", cut)
    assert re.match(r"it is back after [\d.]+ s: ARMED BALANCING", back)
    assert re.fullmatch(r"zero torque after \d+ ms; its node is not heard any more", killed)
    assert again.startswith("it is back after")
    assert shown.end() == 0
    folder = shown._messages.parent
    assert not list(folder.glob("segway-ecc-demo-*"))


@pytest.mark.parametrize(
    ("robot", "why"),
    [
        ("cart", "is all model: demo needs one with drives, such as segway"),
        ("segway-hoverboard", "is on no CAN bus: its demo needs ROS (--ros)"),
    ],
)
def test_a_robot_that_cannot_be_shown_is_refused(segway_ecc: Run, robot: str, why: str) -> None:
    outcome = segway_ecc("demo", robot, "--no-ros", "--port", "0")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.errors == [f"segway-ecc: robot '{robot}' {why}"]


@pytest.mark.parametrize("port", ["-1", "65536"])
def test_a_port_that_is_none_is_refused(segway_ecc: Run, port: str) -> None:
    outcome = segway_ecc("demo", f"--port={port}")
    assert (outcome.code, outcome.errors) == (2, ["segway-ecc: --port is 0 to 65535"])
