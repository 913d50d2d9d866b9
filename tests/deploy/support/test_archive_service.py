# SPDX-License-Identifier: MIT
"""A robot's archive over real DDS: listed, fetched, a bundle, by the station's client and by ROS' own tools."""

import contextlib
import hashlib
import importlib
import json
import os
import signal
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.archive_client import ArchiveClient, Progress
from segway_ecc.deploy.support.archive_service import ArchiveCalls, NoArchiveError
from segway_ecc.node.errors import NodeError
from segway_ecc.node.ros.runtime import ros_node
from tests.patience import PATIENCE_S
from tests.ros_processes import Start

pytestmark = pytest.mark.ros
CONTENT = hashlib.shake_128(b"log").digest(3_000_000)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("robot") / "logs"
    place.mkdir()
    (place / "a b.mcap").write_bytes(CONTENT)
    (place.parent / "secret").write_text("secret")
    (place / "link").symlink_to(place.parent / "secret")
    return place


@pytest.fixture(scope="module")
def robot(start_for_all: Start, logs: Path, messages: Path) -> Iterator[Any]:
    words = ["log", "archive", "cart", "--namespace", "/alice", "--folder", str(logs), "--rate", "50"]
    process = start_for_all("archive", *words)
    deadline_s = time.monotonic() + PATIENCE_S
    while "handing out" not in (messages / "archive.txt").read_text() and time.monotonic() < deadline_s:
        time.sleep(0.05)
    yield process
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0


@pytest.fixture
def domain(ros_environment: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR"):
        monkeypatch.setenv(name, ros_environment[name])


@pytest.fixture
def calls(domain: None, robot: Any) -> Iterator[ArchiveCalls]:  # noqa: ARG001 - both are there first
    with contextlib.closing(ArchiveCalls()) as calls:
        yield calls


@pytest.fixture
def client(calls: ArchiveCalls, tmp_path: Path) -> Iterator[ArchiveClient]:
    with contextlib.closing(ArchiveClient(calls, tmp_path / "fetched")) as client:
        yield client


def _fetched(client: ArchiveClient, name: str) -> Progress:
    client.begin("/alice", name)
    deadline_s = time.monotonic() + PATIENCE_S
    while (progress := client.progress("/alice")[name]).is_going_on and time.monotonic() < deadline_s:
        time.sleep(0.02)
    return progress


def test_a_log_is_listed_and_fetched_bit_for_bit(client: ArchiveClient, tmp_path: Path) -> None:
    assert [(log.name, log.size) for log in client.logs("/alice")] == [("a b.mcap", len(CONTENT))]
    assert _fetched(client, "a b.mcap") == Progress("done", len(CONTENT), len(CONTENT))
    assert (tmp_path / "fetched" / "%2Falice" / "a b.mcap").read_bytes() == CONTENT


def test_only_logs_are_handed_out(calls: ArchiveCalls) -> None:
    for name in (
        "log/link/0",
        "log/../secret/0",
        "log/../../secret/0",
        "log/gone/0",
        "use_sim_time",
        "",
        "x" * 100_000,
    ):
        assert calls.ask("/alice", name) is None


def test_missing_archive_is_reported_with_what_to_start(calls: ArchiveCalls) -> None:
    with pytest.raises(NoArchiveError) as caught:
        calls.ask("/bob", "logs")
    assert str(caught.value) == (
        "robot /bob hands out nothing; on the robot, start: segway-ecc log archive ROBOT --namespace /bob"
    )
    assert calls.ask("/alice", "bundle") is not None


def test_a_bundle_is_made_on_the_robot_and_fetched(client: ArchiveClient) -> None:
    path = client.bundle("/alice")
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        manifest = json.loads(archive.read("MANIFEST.json"))
        assert archive.read("logs/a b.mcap") == CONTENT
        assert b"name: cart" in archive.read("robot.yaml")
    assert manifest["about"] == {"robot": "cart"}
    assert {part["part"] for part in manifest["parts"]} >= {"versions", "messages", "robots", "logs"}


def test_any_ros_node_can_ask_and_too_many_names_at_once_are_not_answered(
    domain: None,  # noqa: ARG001 - set first
    robot: Any,  # noqa: ARG001 - started first
) -> None:
    rclpy = importlib.import_module("rclpy")
    executors = importlib.import_module("rclpy.executors")
    service = importlib.import_module("rcl_interfaces.srv").GetParameters
    with ros_node("stranger", "") as node:
        client = node.create_client(service, "/alice/archive/get_parameters")
        executor = executors.SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        assert client.wait_for_service(timeout_sec=20.0)
        future = client.call_async(service.Request(names=["logs"] * 4 + ["log/a b.mcap/0"] * 200))
        rclpy.spin_until_future_complete(node, future, executor=executor, timeout_sec=20.0)
        types = [value.type for value in future.result().values]
        executor.shutdown()
    assert types == [9] * 4 + [0] * 200


def test_frozen_archive_is_reported_and_fetch_resumes_when_it_is_back(
    client: ArchiveClient, robot: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("segway_ecc.deploy.support.archive_service._ANSWER_S", 0.5)
    assert len(client.logs("/alice")) == 1
    robot.send_signal(signal.SIGSTOP)
    try:
        with pytest.raises(NodeError, match="the archive of robot /alice gave no answer"):
            client.logs("/alice")
    finally:
        robot.send_signal(signal.SIGCONT)
    _until(lambda: _answers(client))
    assert _fetched(client, "a b.mcap").state == "done"
    assert (tmp_path / "fetched" / "%2Falice" / "a b.mcap").read_bytes() == CONTENT


def test_closing_ends_the_thread_and_refuses(calls: ArchiveCalls) -> None:
    assert calls.ask("/alice", "logs")
    calls.close()
    with pytest.raises(NodeError, match="the station ends"):
        calls.ask("/alice", "logs")


def test_no_rate_is_exceeded(start: Start, domain: None, tmp_path: Path) -> None:  # noqa: ARG001 - the domain is set first
    """Only a lower bound of time: a busy machine may take as long as it likes."""
    (tmp_path / "big").write_bytes(bytes(1_000_000))
    slow = start("slow", "log", "archive", "cart", "--namespace", "/slow", "--folder", str(tmp_path), "--rate", "0.5")
    with contextlib.closing(ArchiveCalls()) as calls:
        _until(lambda: _has(calls))
        begun_s, here = time.monotonic(), 0
        while here < 1_000_000:
            piece = calls.ask("/slow", f"log/big/{here}")
            assert isinstance(piece, bytes)
            assert piece
            here += len(piece)
        # 1 MB at 0.5 MB/s takes 2 s, of which the last piece's time is not waited for.
        assert time.monotonic() - begun_s > 1.8
    os.kill(slow.pid, signal.SIGINT)
    assert slow.wait(PATIENCE_S) == 0


def _has(calls: ArchiveCalls) -> bool:
    try:
        return calls.ask("/slow", "logs") is not None
    except NodeError:
        return False


def _answers(client: ArchiveClient) -> bool:
    try:
        return bool(client.logs("/alice"))
    except NodeError:
        return False


def _until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
