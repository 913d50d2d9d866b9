# SPDX-License-Identifier: MIT
"""The programs in C over the local bus, against the codec of the robot's own software."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    AngularVelocity,
    BoardSetup,
    BoardState,
    BoardStatus,
    Endpoint,
    FrameId,
    LinearAcceleration,
    Payload,
    Wheel,
    WheelCommand,
)
from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.hil.bench.contestants import BenchSite, Contestant, plant, run_contestant
from segway_ecc.hil.bench.rig import BenchPrograms, Bus, Conditions, make_rig, own_cache
from segway_ecc.node.errors import ConfigurationError
from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.compiler, pytest.mark.real_time]

PERIOD_NS = 5_000_000
NOTHING = Conditions(priority=0, idle_states_off=False, memory_locked=False, cores=2, isolated=(), kernel="6.1")
TELEMETRY = frozenset(
    {
        FrameId.LEFT_WHEEL,
        FrameId.RIGHT_WHEEL,
        FrameId.IMU_GYRO,
        FrameId.IMU_ACCELERATION,
        FrameId.BOARD_STATUS,
    }
)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchPrograms]:
    with own_cache():
        yield make_rig(tmp_path_factory.mktemp("rig"), PERIOD_NS)


@pytest.fixture
def place(rig: BenchPrograms, tmp_path: Path) -> BenchSite:
    return BenchSite(rig, Bus("local", tmp_path.name, tmp_path.name), NOTHING, tmp_path)


class Host:
    """The robot's own end of the conversation."""

    def __init__(self, link: Link) -> None:
        self.endpoint = Endpoint(link.send, TELEMETRY)
        self._link = link

    def hear_until(self, wanted: type | BoardState) -> Payload:
        """The first frame with such a payload, or with such a state; what came with it is heard too."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            heard = [self.endpoint.check(frame) for frame in self._link.receive()]
            for payload in heard:
                if payload is not None and _is(payload, wanted):
                    return payload
        pytest.fail(f"the board never sent {wanted}")


def _is(payload: Payload, wanted: type | BoardState) -> bool:
    if isinstance(wanted, BoardState):
        return isinstance(payload, BoardStatus) and payload.state is wanted
    return isinstance(payload, wanted)


@pytest.fixture
def host(place: BenchSite) -> Iterator[Host]:
    link = make_can_link("local", place.bus.channel, 500_000)
    link.open()
    yield Host(link)
    link.close()


def test_the_board_sends_frames_that_the_robot_takes(place: BenchSite, host: Host) -> None:
    with plant(place):
        kinds = (Wheel, AngularVelocity, LinearAcceleration, BoardStatus)
        payloads = [host.hear_until(kind) for kind in kinds]
    assert payloads[0] == Wheel(0.0, 0.0)
    acceleration, status = payloads[2], payloads[3]
    assert isinstance(acceleration, LinearAcceleration)
    assert acceleration.z == pytest.approx(9.81, abs=0.02)
    assert isinstance(status, BoardStatus)
    assert status.bus_voltage == pytest.approx(24.0)
    assert not host.endpoint.refused
    assert not host.endpoint.lost


def test_the_board_obeys_moves_refuses_and_stops_by_its_watchdog(place: BenchSite, host: Host) -> None:
    with plant(place) as seen:
        host.endpoint.send(FrameId.BOARD_SETUP, BoardSetup(0.03))
        host.endpoint.send(FrameId.WHEEL_COMMAND, WheelCommand(3.0, -3.0, enable=True))
        host.hear_until(BoardState.ENABLED)
        status = host.hear_until(BoardState.WATCHDOG)
        host.endpoint.send(FrameId.WHEEL_COMMAND, WheelCommand(3.0, 3.0, enable=True))
        host.endpoint.send(FrameId.WHEEL_COMMAND, WheelCommand(0.0, 0.0, enable=False))
        host.hear_until(BoardState.DISABLED)
        moved = host.hear_until(Wheel)
        for _ in range(2):  # each counts from zero: the first is not the next count, the second repeats it
            with contextlib.closing(make_can_link("local", place.bus.channel, 500_000)) as other:
                other.open()
                Endpoint(other.send, frozenset()).send(FrameId.WHEEL_COMMAND, WheelCommand(0.0, 0.0, enable=False))
            host.hear_until(BoardStatus)
            host.hear_until(BoardStatus)
    assert isinstance(status, BoardStatus)
    assert status.watchdog_s == pytest.approx(0.03)
    assert isinstance(moved, Wheel)
    assert abs(moved.angle) > 0.0
    assert (seen["commands"], seen["refused"], seen["state"]) == (3, 2, 0)


def test_the_loop_in_c_commands_once_for_each_cycle_at_its_deadlines(place: BenchSite) -> None:
    with plant(place) as seen:
        ran = run_contestant(Contestant.C, place, 0.5)
    samples = ran.samples
    assert 1 < len(samples) <= 100  # fewer where this machine let deadlines pass
    steps = np.diff(samples[:, 0])
    assert (steps % PERIOD_NS == 0).all()
    assert (steps > 0).all()
    assert (samples[:, 1] >= samples[:, 0]).all()
    assert (np.diff(samples[:, 2]) > 0).all()
    assert (samples[:, 3] > 0).all()
    assert (seen["commands"], seen["refused"]) == (len(samples), 0)
    assert ran.start_s is not None


def test_the_bare_loop_sends_nothing(place: BenchSite) -> None:
    with plant(place) as seen:
        ran = run_contestant(Contestant.BARE, place, 0.5)
    assert 1 < len(ran.samples) <= 100
    assert seen["commands"] == 0
    assert ran.start_s is None


@pytest.mark.ros
def test_the_users_loop_does_the_same_work(place: BenchSite) -> None:
    with plant(place) as seen:
        ran = run_contestant(Contestant.USER, place, 1.0)
    samples = ran.samples
    assert 1 < len(samples) <= 200
    assert (seen["commands"], seen["refused"]) == (len(samples), 0)


def test_our_own_loop_is_sampled_once_a_cycle_and_drives_to_the_end(place: BenchSite) -> None:
    with plant(place) as seen:
        ran = run_contestant(Contestant.OURS, place, 1.0)
    assert ran.report is not None
    assert len(ran.samples) == ran.report["cycles"] <= 200
    assert seen["commands"] >= ran.report["cycles"]
    assert seen["refused"] == 0


def test_a_program_that_fails_is_reported_with_its_last_words(place: BenchSite) -> None:
    away = BenchSite(place.rig, Bus("socketcan", "nowhere0", "nowhere0"), place.conditions, place.folder)
    with pytest.raises(ConfigurationError, match=r"^the program 'c' ended with exit code 1: nowhere0: "):
        run_contestant(Contestant.C, away, 0.5)
    with pytest.raises(ConfigurationError, match=r"^the plant of the bench does not start on nowhere0"), plant(away):
        pass
