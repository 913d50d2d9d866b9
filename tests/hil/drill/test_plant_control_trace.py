# SPDX-License-Identifier: MIT
"""From what the motors gave to when the torque ended."""

from pathlib import Path

import pytest

from segway_ecc.hil.drill.plant_control import Tick, Torque, driven_since_ns, read_trace, torque_after, trace_writer

MS = 1_000_000


def ticks(pattern: str) -> list[Tick]:
    """A tick every 5 ms from 5 ms on; x where a motor was driven."""
    return [Tick((number + 1) * 5 * MS, letter == "x") for number, letter in enumerate(pattern)]


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    with path.open("w", encoding="ascii") as file:
        write = trace_writer(file, ["left.torque", "right.torque"])
        write(5, 1005, [0.0, 0.0])
        write(10, 1010, [0.0, -2e-4])
        write(15, 1015, [2.5, 0.0])
        write(20, 1020, [-0.0, 0.0])
        write(25, 1025, [-9e-5, 9e-5])

    assert path.read_text().splitlines()[:3] == [
        "monotonic_ns,wall_ns,left.torque,right.torque",
        "5,1005,0.0,0.0",
        "10,1010,0.0,-0.0002",
    ]
    assert read_trace(path) == [
        Tick(5, is_driven=False),
        Tick(10, is_driven=True),
        Tick(15, is_driven=True),
        Tick(20, is_driven=False),
        Tick(25, is_driven=False),
    ]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", []),
        ("monotonic_ns,wall_ns,left.to", []),
        ("monotonic_ns,wall_ns,left.torque\n", []),
        ("monotonic_ns,wall_ns,left.torque\n5,6,1.0\n10,11,0", [Tick(5, is_driven=True)]),
        ("monotonic_ns,wall_ns,left.torque\n5,6,1.0\n10", [Tick(5, is_driven=True)]),
    ],
)
def test_a_line_that_is_not_whole_is_left_out(tmp_path: Path, text: str, found: list[Tick]) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(text)
    assert read_trace(path) == found


def test_a_file_that_is_not_there_yet_holds_nothing(tmp_path: Path) -> None:
    assert read_trace(tmp_path / "no") == []


def test_driven_since_the_first_torque() -> None:
    assert driven_since_ns(ticks("..x.x")) == 15 * MS
    assert driven_since_ns(ticks("...")) is None


@pytest.mark.parametrize(
    ("pattern", "fault_ms", "until_ms", "expected"),
    [
        ("xxxx....", 12, 40, Torque(0.008, 0.013, 0.0)),
        ("xxxx....", 20, 40, Torque(0.0, 0.005, 0.0)),  # a tick at the fault itself is one from before it
        ("xxxx....", 22, 40, Torque(0.0, 0.003, 0.0)),
        ("xxxxxxxx", 12, 40, Torque(0.028, None, 0.0)),
        ("xxxxxxx.", 12, 35, Torque(0.023, None, 0.0)),  # what comes after the end of looking does not count
        ("xxx..xxx", 12, 40, Torque(0.028, None, 0.015)),  # from the last torque at 15 ms to the next at 30 ms
        ("xx....xx", 12, 40, Torque(0.028, None, 0.023)),  # none since the fault
        ("xxx.x..xx", 12, 45, Torque(0.033, None, 0.015)),
        ("xxxx...x..", 12, 50, Torque(0.028, 0.033, 0.02)),  # torque that comes back has not ended
        ("........", 12, 40, Torque(0.0, 0.003, 0.0)),
        ("........", 20, 40, Torque(0.0, 0.005, 0.0)),
        ("xxx.xxxx", 12, 40, Torque(0.028, None, 0.01)),  # a single tick without torque is a gap too
        ("", 12, 40, Torque(0.0, None, 0.0)),
    ],
)
def test_torque_after_a_fault(pattern: str, fault_ms: int, until_ms: int, expected: Torque) -> None:
    found = torque_after(ticks(pattern), fault_ms * MS, until_ms * MS)
    assert found == pytest.approx(expected)
