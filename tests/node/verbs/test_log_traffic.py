# SPDX-License-Identifier: MIT
"""`segway-ecc log traffic`: the raw traffic on a robot's bus."""

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

Run = Callable[..., Any]


def test_what_passes_on_the_bus_is_in_the_log(segway_ecc: Run, tmp_path: Path) -> None:
    path, over = tmp_path / "bus.log", threading.Event()

    def send() -> None:
        with can.Bus(interface="local", channel="traffic-test") as bus:
            while not over.wait(0.005):
                bus.send(can.Message(arbitration_id=0x123, data=[1, 2], is_extended_id=False))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        words = ("--interface", "local", "--channel", "traffic-test", "--out", str(path), "--duration", "0.5", "--json")
        outcome = segway_ecc("log", "traffic", "cart-can", *words)
    finally:
        over.set()
        sender.join()
    found = list(can.CanutilsLogReader(path))

    assert outcome.code == 0
    assert outcome.errors == [f"segway-ecc: bus traffic: {path}"]
    assert json.loads(outcome.out) == {"frames": len(found)}
    assert len(found) > 0
    assert {(frame.arbitration_id, bytes(frame.data)) for frame in found} == {(0x123, b"\x01\x02")}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("cart",), "robot 'cart' is on no CAN bus"),
        (("cart-can", "--duration", "0"), "--duration must be more than 0 s"),
        (("cart-can", "--limit", "0"), "--limit must be 0.01 MB at least"),
    ],
)
def test_what_makes_no_sense_is_refused(segway_ecc: Run, tmp_path: Path, words: tuple[str, ...], expected: str) -> None:
    outcome = segway_ecc("log", "traffic", *words, "--out", str(tmp_path / "bus.log"))

    assert outcome.code == 2
    assert expected in outcome.errors[-1]
