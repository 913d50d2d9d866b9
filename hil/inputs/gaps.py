# SPDX-License-Identifier: MIT
"""Item 5: gaps in the telemetry of all devices."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.drill.trial import LIMIT_S
from segway_ecc.hil.inputs.rig import Rig
from segway_ecc.hil.inputs.trial import Do, Event, InputTrial, balances, falls

_ITEM: Final = 5
_HALF_A_TICK_S: Final = 0.0025
"""Of the drives: a line takes effect at the next one."""
_RIDE_THROUGH_S: Final = 0.05
"""`hardware.ride_through_s` of both robots."""


def _gap(length_s: float) -> Do:
    def do(rig: Rig, _undo: ExitStack) -> Event:
        begun_ns = rig.request("mute")
        time.sleep(max(begun_ns * 1e-9 + length_s - _HALF_A_TICK_S - time.monotonic(), 0.0))
        return Event(begun_ns, [f"no telemetry for {(rig.request('heal') - begun_ns) * 1e-6:.1f} ms"])

    return do


def trials() -> Sequence[InputTrial]:
    """All of them."""
    ridden = {0.02: r"for (1[5-9]|[23]\d)\.\d ms", 0.05: r"for (4[5-9]|5\d)\.\d ms"}
    return [
        *(
            InputTrial(_ITEM, f"no telemetry for {length_s * 1e3:.0f} ms", _gap(length_s), balances(text))
            for length_s, text in ridden.items()
        ),
        InputTrial(_ITEM, "no telemetry for 80 ms", _gap(0.08), falls("^FAULT.*is too old", LIMIT_S + _RIDE_THROUGH_S)),
    ]
