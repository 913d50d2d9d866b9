# SPDX-License-Identifier: MIT
"""Item 7: signals, and a node that is held up."""

import signal
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.drill.parts import stopped
from segway_ecc.hil.inputs.rig import Arrangement, Misbehaviour, Rig
from segway_ecc.hil.inputs.trial import Do, Event, InputTrial, ends, falls, sits_down
from segway_ecc.node.safety.posture import Posture

_ITEM: Final = 7
_STOPPED_S: Final = 0.5
_LONGER_STEPS: Final = (("model:\n", "model:\n  step_limit_s: 1.0\n"),)
"""So that a step of 100 ms is not ended."""
_SEQUENCE_S: Final = 6.0


def _stop_and_continue(rig: Rig, _undo: ExitStack) -> Event:
    now_ns = time.monotonic_ns()
    with stopped(rig.parts.pid("node")):
        time.sleep(_STOPPED_S)
    return Event(now_ns)


def _block(rig: Rig, _undo: ExitStack) -> Event:
    return Event(rig.misbehave())


def _send(number: signal.Signals, *, again: bool = False) -> Do:
    def do(rig: Rig, _undo: ExitStack) -> Event:
        now_ns = time.monotonic_ns()
        rig.parts.node.process.send_signal(number)
        if again:
            rig.wait(lambda: rig.state.posture == Posture.SITTING_DOWN, "it does not sit down")
            now_ns = time.monotonic_ns()
            rig.parts.node.process.send_signal(number)
        return Event(now_ns)

    return do


def _wait_for_end(rig: Rig, _undo: ExitStack) -> Event:
    rig.wait(lambda: rig.state.posture == Posture.SITTING_DOWN, "it does not sit down")
    return Event(time.monotonic_ns())


def trials() -> Sequence[InputTrial]:
    """All of them."""
    drives = Arrangement(drives=True)
    return [
        *(
            InputTrial(_ITEM, f"{number.name} while it drives", _send(number), sits_down("SITTING DOWN"), drives)
            for number in (signal.SIGINT, signal.SIGTERM)
        ),
        InputTrial(
            _ITEM, "a second SIGINT while it sits down", _send(signal.SIGINT, again=True), ends("SIGINT", 0), drives
        ),
        InputTrial(
            _ITEM,
            "the end of a sequence",
            _wait_for_end,
            sits_down("SITTING DOWN"),
            Arrangement(drives=True, drives_for_s=_SEQUENCE_S),
        ),
        InputTrial(
            _ITEM, "SIGSTOP, and SIGCONT after 0.5 s", _stop_and_continue, falls("^FAULT.*the guard stopped the drives")
        ),
        InputTrial(
            _ITEM,
            "the model blocks for 100 ms",
            _block,
            falls("^FAULT.*the guard stopped the drives"),
            Arrangement(_LONGER_STEPS, Misbehaviour(once="time.sleep(0.1)")),
        ),
    ]
