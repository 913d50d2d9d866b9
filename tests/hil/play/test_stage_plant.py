# SPDX-License-Identifier: MIT
"""What is told to the plant's process."""

import os
from collections.abc import Iterator

import pytest

from segway_ecc.hil.play.stage import PlantControls

MS = 1_000_000


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    os.set_blocking(reader, False)
    yield reader, writer
    os.close(reader)
    os.close(writer)


def runs() -> bool:
    return True


def told(reader: int) -> list[str]:
    try:
        return os.read(reader, 1 << 20).decode().splitlines()
    except BlockingIOError:
        return []


def test_a_push_lasts_a_tenth_of_a_second(pipe: tuple[int, int]) -> None:
    rig = PlantControls(pipe[1], 10 * MS, runs, can_be_pushed=True)
    rig.push()
    assert told(pipe[0]) == ["write PushForce 50.0"]
    for _ in range(9):
        rig.work()
    assert told(pipe[0]) == []
    rig.work()
    assert told(pipe[0]) == ["write PushForce 0"]
    rig.work()
    assert told(pipe[0]) == []


def test_what_cannot_be_pushed_is_not(pipe: tuple[int, int]) -> None:
    rig = PlantControls(pipe[1], 10 * MS, runs, can_be_pushed=False)
    rig.push()
    for _ in range(30):
        rig.work()
    assert told(pipe[0]) == []


def test_a_whole_bus_is_cut_and_a_cut_one_repaired(pipe: tuple[int, int]) -> None:
    rig = PlantControls(pipe[1], 10 * MS, runs, can_be_pushed=False)
    states = []
    for do in (rig.repair_bus, rig.cut_bus, rig.cut_bus, rig.repair_bus, rig.cut_bus):
        do()
        states.append(rig.is_bus_broken)
    assert told(pipe[0]) == ["cut", "heal", "cut"]
    assert states == [False, True, True, False, True]


def test_a_plant_that_takes_nothing_is_not_waited_for_and_a_push_ends_once_it_does(pipe: tuple[int, int]) -> None:
    rig = PlantControls(pipe[1], 50 * MS, runs, can_be_pushed=True)  # a push lasts two cycles
    rig.push()
    told(pipe[0])
    while True:
        try:
            os.write(pipe[1], bytes(4096))
        except BlockingIOError:
            break
    rig.cut_bus()
    assert not rig.is_bus_broken
    for _ in range(5):
        rig.work()
    while told(pipe[0]):
        pass
    rig.work()
    assert told(pipe[0]) == ["write PushForce 0"]
