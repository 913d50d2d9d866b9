# SPDX-License-Identifier: MIT
"""The last ten minutes of each robot, for a page that is loaded."""

import asyncio
from pathlib import Path

import pytest

from segway_ecc.deploy.station.views import FleetView, RobotView
from segway_ecc.deploy.station.web.traces import Traces, TraceView
from tests.deploy.station.web.scripted_station import full_robot
from tests.deploy.station.web.serving import browser, receive, served

NOTHING = TraceView(
    time_s=[], pitch=[], linear_velocity=[], linear_setpoint=[], angular_velocity=[], angular_setpoint=[]
)


def _view(time_s: float, *robots: RobotView) -> FleetView:
    return FleetView(time_s=time_s, robots=robots)


def test_five_pictures_a_second_are_kept() -> None:
    traces = Traces()
    for number in range(40):
        traces.add(_view(7.0 + 0.05 * number, RobotView(robot="/alice", is_alive=True, pitch=0.01 * number)))
    trace = traces.of("/alice")
    assert trace.time_s == pytest.approx([7.0 + 0.2 * number for number in range(10)])
    assert trace.pitch == pytest.approx([0.04 * number for number in range(10)])


def test_each_line_has_its_value_and_none_where_there_is_none() -> None:
    traces = Traces()
    first = RobotView(robot="/", is_alive=True, pitch=0.12345678, linear_velocity=1.0, angular_velocity=-2.0)
    second = RobotView(robot="/", is_alive=True, linear_setpoint=3.0, angular_setpoint=-4.0)
    lost = RobotView(robot="/", is_alive=False, pitch=5.0)
    for number, robot in enumerate((first, second, lost)):
        traces.add(_view(number, robot))
    assert traces.of("/") == TraceView(
        time_s=[0.0, 1.0, 2.0],
        pitch=[0.1235, None, None],
        linear_velocity=[1.0, None, None],
        linear_setpoint=[None, 3.0, None],
        angular_velocity=[-2.0, None, None],
        angular_setpoint=[None, -4.0, None],
    )


def test_ten_minutes_are_kept() -> None:
    traces = Traces()
    for number in range(3600):
        traces.add(_view(0.2 * number, RobotView(robot="/", is_alive=True, pitch=float(number))))
    trace = traces.of("/")
    assert trace.pitch == [float(number) for number in range(600, 3600)]
    assert trace.time_s[-1] - trace.time_s[0] == pytest.approx(600.0, abs=0.3)


def test_robots_are_kept_apart_and_one_that_is_gone_is_forgotten() -> None:
    traces = Traces()
    alice, bob = (RobotView(robot=name, is_alive=True, pitch=pitch) for name, pitch in (("/alice", 1.0), ("/bob", 2.0)))
    traces.add(_view(1.0, alice, bob))
    assert (traces.of("/alice").pitch, traces.of("/bob").pitch) == ([1.0], [2.0])
    traces.add(_view(2.0, bob))
    assert traces.of("/alice") == NOTHING
    assert traces.of("/bob").pitch == [2.0, 2.0]
    assert traces.of("/nobody") == NOTHING


def test_a_page_gets_them_compressed(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client, client.ws_connect("/socket") as socket:
            here.station.robots = [full_robot("/robot1")]
            while not (await receive(socket, "fleet"))["robots"]:
                pass
            time_s = 0.0
            while not time_s:
                await receive(socket, "fleet")
                async with client.get("/robots/%2Frobot1/trace") as answer:
                    assert answer.status == 200
                    trace = await answer.json()
                time_s = sum(trace["time_s"])
            assert answer.headers["Content-Encoding"] in {"gzip", "deflate"}
            assert answer.headers["Cache-Control"] == "no-store"
            assert set(trace["pitch"]) == {0.0123}

    asyncio.run(scenario())
