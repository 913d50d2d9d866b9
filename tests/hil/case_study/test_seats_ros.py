# SPDX-License-Identifier: MIT
"""A run through ROS is compared with the model alone; here nothing crosses ROS, its processes only pretend."""

import contextlib
import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.case_study import seats
from segway_ecc.hil.case_study.seats import OfflineSeat, RosSeat
from segway_ecc.hil.case_study.study import Seat
from segway_ecc.hil.errors import RigError
from segway_ecc.node.sequence.manoeuvre import Odometry, single_segment

MANOEUVRE = single_segment(1.0, 0.5, 0.1)
START_NS = 1_700_000_000_000_000_000


class Pretend:
    def result(self, _timeout_s: float, _partner: object) -> dict[str, Any]:
        return {"graph": []}


@pytest.fixture
def published(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[float]]:
    """What the sequence's process writes as received: at first all that the model gives, exactly."""
    way = OfflineSeat(tmp_path).run("expected", MANOEUVRE).trajectory
    rows = [
        [START_NS + 10_000_000 * cycle, x, y, 0.0, v, w]
        for cycle, (x, y, v, w) in enumerate(zip(way.x, way.y, way.linear_velocity, way.angular_velocity, strict=True))
    ]

    @contextlib.contextmanager
    def command(words: Sequence[str], *_arguments: object) -> Iterator[Pretend]:
        if "--csv" in words:
            with Path(words[words.index("--csv") + 1]).open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows([Odometry._fields, *rows])
        yield Pretend()

    monkeypatch.setattr(seats, "command", command)
    monkeypatch.setattr(seats, "require_ros", lambda: None)
    return rows


@pytest.mark.usefixtures("published")
def test_a_run_that_is_bit_identical_to_the_model_is_a_result(tmp_path: Path) -> None:
    found = RosSeat(tmp_path, tmp_path).run("same", MANOEUVRE).trajectory

    assert found.seat is Seat.ROS
    assert len(found.x) == 11


def test_a_run_that_differs_in_one_bit_has_failed(published: list[list[float]], tmp_path: Path) -> None:
    published[5][1] += 2**-50
    with pytest.raises(RigError, match=r"not bit-identical to the offline run: 11 of 11 points, the last one 0 m off"):
        RosSeat(tmp_path, tmp_path).run("differs", MANOEUVRE)


def test_a_run_that_lacks_a_point_has_failed(published: list[list[float]], tmp_path: Path) -> None:
    del published[5]
    with pytest.raises(RigError, match=r"10 of 11 points"):
        RosSeat(tmp_path, tmp_path).run("lacks", MANOEUVRE)
