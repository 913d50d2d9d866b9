# SPDX-License-Identifier: MIT
"""Item 3: unsafe robot files, which `deploy check` refuses or warns of."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.inputs.rig import Rig
from segway_ecc.hil.inputs.trial import Do, Event, InputTrial, balances
from segway_ecc.hil.processes import command

_ITEM: Final = 3
_REFUSED, _OUT_OF_RANGE = 2, 3


def _check(change: Callable[[str], str]) -> Do:
    """Another robot is checked beside the one that runs."""

    def do(rig: Rig, undo: ExitStack) -> Event:
        text = rig.file.read_text(encoding="utf-8")
        unsafe = rig.file.with_name("unsafe.yaml")
        unsafe.write_text(change(text), encoding="utf-8")
        now_ns, messages = time.monotonic_ns(), rig.parts.setup.messages("check")
        checked = undo.enter_context(command(["deploy", "check", str(unsafe)], messages))
        rig.wait(lambda: checked.process.poll() is not None, "deploy check did not end")
        answers = ["nothing was changed"] if change(text) == text else messages.read_text(encoding="utf-8").splitlines()
        return Event(now_ns, answers, checked.process.returncode)

    return do


def _replaced(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new)


def _without_safety(text: str) -> str:
    before, _, rest = text.partition("\nsafety:\n")
    _, name, after = rest.partition("\nstation:")
    return before + name + after


def _swapped(text: str) -> str:
    swapped = text.replace("LeftAngle: left.angle", "LeftAngle: right.angle")
    return swapped.replace("RightAngle: right.angle", "RightAngle: left.angle")


def trials() -> Sequence[InputTrial]:
    """All of them."""
    radius = _replaced("  parameters:\n", "  parameters:\n    WheelRadius: -0.05\n")
    files = [
        ("a negative wheel radius", radius, "'WheelRadius' cannot be", _OUT_OF_RANGE),
        (
            "a gain that is reversed",
            _replaced("PitchGain: -12.3446", "PitchGain: 12.3446"),
            "'PitchGain' cannot be",
            _OUT_OF_RANGE,
        ),
        (
            "a hundredfold gain",
            _replaced("PitchGain: -12.3446", "PitchGain: -1234.46"),
            "refused: .*PitchGain",
            _REFUSED,
        ),
        ("left and right swapped", _swapped, "refused: .*LeftAngle", _REFUSED),
        ("no section safety", _without_safety, "warning: .*safety", 0),
    ]
    return [
        InputTrial(_ITEM, f"a robot file with {name}", _check(change), balances(reason, code))
        for name, change, reason, code in files
    ]
