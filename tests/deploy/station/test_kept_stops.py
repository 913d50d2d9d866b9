# SPDX-License-Identifier: MIT
"""Stops on the disk: there before a station promises it, and found by the one that comes after it."""

import threading
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.kept_stops import NAME, KeptStop, KeptStops
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import Act, Command

ANN = KeptStop("ann", 1_700_000_000_000_000_000)
LATE_S = 20.0


def no_log(_: str) -> None:
    pytest.fail("nothing is to be logged")


def test_what_is_kept_is_found_by_the_next(tmp_path: Path) -> None:
    first = KeptStops(tmp_path, no_log)
    assert first.load() == {}
    first.keep({"/r1": ANN})
    first.close()
    assert first.on_disk == {"/r1": ANN}
    assert (tmp_path / NAME).stat().st_mode & 0o777 == 0o600
    second = KeptStops(tmp_path, no_log)
    assert second.load() == {"/r1": ANN}
    second.keep({})
    second.close()
    assert KeptStops(tmp_path, no_log).load() == {}


@pytest.mark.parametrize("content", [b"", b"{", b"[" * 100_000, b'{"/r1": 3}', b"\xff"])
def test_file_that_cannot_be_read_is_reported_and_ends_nothing(tmp_path: Path, content: bytes) -> None:
    (tmp_path / NAME).write_bytes(content)
    texts: list[str] = []
    stops = KeptStops(tmp_path, texts.append)
    assert stops.load() == {}
    assert len(texts) == 1
    assert "press stop again" in texts[0]
    stops.keep({"/r1": ANN})
    stops.close()
    assert stops.on_disk == {"/r1": ANN}


def test_names_that_are_no_namespace_are_not_restored(tmp_path: Path) -> None:
    (tmp_path / NAME).write_bytes(b'{"/r1": {"who": "ann", "wall_ns": 1}, "../x": {"who": "ann", "wall_ns": 1}}')
    stops = KeptStops(tmp_path, no_log)
    assert list(stops.load()) == ["/r1"]
    stops.close()


def test_full_disk_is_logged_once_and_tried_again(tmp_path: Path) -> None:
    texts: list[str] = []
    tries, written = [OSError(28, "No space left on device"), OSError(28, "No space left on device")], threading.Event()

    def write(_path: Path, _content: bytes) -> None:
        if tries:
            raise tries.pop()
        written.set()

    stops = KeptStops(tmp_path, texts.append, write)
    stops.load()
    stops.keep({"/r1": ANN})
    assert written.wait(LATE_S)
    stops.close()
    assert stops.on_disk == {"/r1": ANN}
    assert len(texts) == 1
    assert texts[0].endswith("a stop lasts only as long as this station runs (No space left on device)")


def test_stop_is_restored_by_a_station_that_is_started_again(tmp_path: Path, replies: Any) -> None:
    first = Station("base", folder=tmp_path)
    assert first._kept is not None
    first._kept.load()
    first.submit("ann", Command(id=1, robot="/r1", act=Act.STOP), replies)
    first._carry_out()
    first._keep_stops()
    assert not first._view(0).robots[0].stop_kept or first._kept.on_disk
    first.close()
    assert first._view(0).robots[0].stop_kept
    second = Station("base", folder=tmp_path)
    assert second._kept is not None
    for robot, stop in second._kept.load().items():
        second._restore(robot, stop)
    second._carry_out()
    second._keep_stops()
    shown = second._view(0).robots[0]
    assert (shown.robot, shown.stop, shown.stop_kept) == ("/r1", "requested", True)
    assert [event.text.split(",")[0] for event in second.events(0)] == ["stop of ann"]
    second.close()
