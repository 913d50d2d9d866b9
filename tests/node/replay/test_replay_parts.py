# SPDX-License-Identifier: MIT
"""A run in several files is replayed as whole only where each of them is there, once and in its place."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, NoStage
from segway_ecc.node.recording.log_quota import part_path
from segway_ecc.node.replay.replay import Outcome, replay
from segway_ecc.node.robot import build_robot
from tests.node.replay.conftest import InParts

CYCLES = 90
BORDERS = (30, 60)
PARTS = (1, 2, 3)
Run = Callable[..., Any]


def drive(path: Path, *borders: int) -> Path:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    robot.loop(NoStage(), InParts(path, robot, *borders)).run(CYCLES)
    return path


@pytest.fixture
def other(tmp_path: Path) -> Path:
    """Another run of the same robot, bit for bit the same but for what it is."""
    return drive(tmp_path / "other.mcap", *BORDERS)


def drop(path: Path, number: int, _other: Path) -> None:
    part_path(path, number).unlink()


def duplicate(path: Path, number: int, _other: Path) -> None:
    shutil.copy(part_path(path, number), part_path(path, len(PARTS) + 1))


def duplicate_over_the_next(path: Path, number: int, _other: Path) -> None:
    shutil.copy(part_path(path, number), part_path(path, number + 1))


def swap(path: Path, number: int, _other: Path) -> None:
    one, two = part_path(path, number), part_path(path, number % len(PARTS) + 1)
    one.rename(path.with_name("third"))
    two.rename(one)
    path.with_name("third").rename(two)


def replace(path: Path, number: int, other: Path) -> None:
    shutil.copy(part_path(other, number), part_path(path, number))


def replace_and_all_behind(path: Path, number: int, other: Path) -> None:
    for behind in range(max(number, 2), len(PARTS) + 1):
        replace(path, behind, other)


def close_early(path: Path, number: int, other: Path) -> None:
    """The part of a shorter run, whose end is in it."""
    replace(path, number, drive(other.with_name("short.mcap"), *BORDERS[: number - 1]))


@pytest.mark.variants(6)
@pytest.mark.parametrize("number", PARTS)
@pytest.mark.parametrize(
    "change", [drop, duplicate, duplicate_over_the_next, swap, replace, replace_and_all_behind, close_early]
)
def test_a_run_of_which_a_file_is_not_its_own_is_never_whole(
    path: Path, other: Path, change: Callable[[Path, int, Path], None], number: int, segway_ecc: Run
) -> None:
    drive(path, *BORDERS)
    change(path, number, other)

    if number == 1 and change is close_early:  # which is a whole log, beside the files of another
        assert replay(path).is_whole
    else:
        assert segway_ecc("log", "replay", str(path)).code == 9


def test_a_run_whose_files_are_all_there_is_whole(path: Path, other: Path, segway_ecc: Run) -> None:
    drive(path, *BORDERS)

    assert segway_ecc("log", "replay", str(path)).code == 0
    assert replay(path).cycles == replay(other).cycles == CYCLES


def found(path: Path, change: Callable[[Path, int, Path], None], number: int, other: Path) -> Outcome:
    change(drive(path, *BORDERS), number, other)
    return replay(path)


def test_what_is_not_whole_is_named(path: Path, other: Path) -> None:
    assert found(path, drop, 3, other).is_cut
    assert found(path, duplicate, 2, other).damage == ["run-0004.mcap: it is part 2 of the run, where part 4 should be"]
    part_path(path, 4).unlink()
    assert found(path, replace, 2, other).damage == [
        "run-0002.mcap: it is of another run",
        "run-0003.mcap: it is part 3 of the run, where part 2 should be",
    ]


def test_a_log_that_has_its_end_is_not_spoiled_by_another_beside_it(path: Path, other: Path) -> None:
    drive(path)
    shutil.copy(other, path.with_name("run-2024.mcap"))

    assert replay(path).is_whole


def test_cycles_that_come_twice_are_damage(path: Path) -> None:
    class Again(InParts):
        def write(self, record: CycleRecord) -> None:
            super().write(record)
            if record.cycle in {39, 41}:
                super().write(record)

    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    robot.loop(NoStage(), Again(path, robot)).run(CYCLES)
    outcome = replay(path)

    assert (outcome.cycles, outcome.gap, outcome.difference) == (CYCLES, None, None)
    assert outcome.damage == ["run.mcap: there are cycles that come twice or out of order"]
    assert not outcome.is_whole


@pytest.mark.parametrize("name", ["run.mcap", "run.whole.mcap"])
def test_a_log_with_another_behind_it_in_its_file_is_damaged(
    path: Path, other: Path, segway_ecc: Run, name: str
) -> None:
    size = drive(path).stat().st_size
    path.write_bytes(path.read_bytes() + other.read_bytes())
    assert segway_ecc("log", "repair", str(path)).code == 9
    outcome = segway_ecc("log", "replay", str(path.with_name(name)))

    assert (outcome.code, outcome.out.split(",")[0]) == (9, f"identical: {CYCLES} cycles")
    assert f"segway-ecc: run.mcap: another log begins at byte {size + 8}, and is not read" in str(outcome.errors)
