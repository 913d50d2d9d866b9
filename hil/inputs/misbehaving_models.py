# SPDX-License-Identifier: MIT
"""Item 2: models that misbehave while the robot drives."""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.drill.trial import LIMIT_S
from segway_ecc.hil.inputs.rig import Arrangement, Misbehaviour, Rig
from segway_ecc.hil.inputs.trial import Event, InputTrial, balances, ends, falls

_ITEM: Final = 2
_FAILED: Final = 3
_SEGFAULT, _ABORTED = 139, 134
_ABSURD: Final = r"^FAULT.*e\+30[78]"
_CYCLE: Final = r"failed in its step of cycle \d+ \(last inputs: .*\): "
_ENDS: Final = (
    ("raises", "1 / 0", _FAILED, r"failed in cycle \d+ while running: ZeroDivisionError"),
    ("calls sys.exit(0)", "sys.exit(0)", _FAILED, r"failed in cycle \d+ while running: SystemExit"),
    ("calls os._exit(0)", "os._exit(0)", _FAILED, r"failed in cycle \d+ while running: .*os\._exit"),
    ("calls abort()", "os.abort()", _ABORTED, f"{_CYCLE}aborted"),
    (
        "ends the process by the system call exit_group(0)",
        "ctypes.CDLL(None)._exit(0)",
        _ABORTED,
        f"{_CYCLE}it ended the process with status 0",
    ),
    ("reads from address 0", "ctypes.string_at(0)", _SEGFAULT, f"{_CYCLE}segmentation fault"),
    ("loops for ever", "while True: pass", _ABORTED, f"{_CYCLE}it did not return within"),
)


_FAULTS: Final = (
    ("gives NaN", "y = [math.nan] * len(y)", "^FAULT.*not finite", LIMIT_S),
    (
        "gives a place of 1e308 m",
        "y = [1e308 if out.name == 'X' else v for v, out in zip(y, self.outputs)]",
        _ABSURD,
        LIMIT_S,
    ),
    ("gives a command 1e307 times as large as it may be", "y = commands(self, y, 1e307)", _ABSURD, LIMIT_S),
    ("gives all of its command, the other way in each step", "y = commands(self, y, turns())", "^FAULT.*sign", 0.1),
    ("takes 12 ms for each step of 5 ms", "time.sleep(0.012)", "^FAULT.*(late|deadline|missed)", 0.5),
)
"""With the time to zero, s: commands that change their sign, and missed deadlines, are a fault once there are many."""


def _misbehave(rig: Rig, _undo: ExitStack) -> Event:
    return Event(rig.misbehave())


def trials() -> Sequence[InputTrial]:
    """All of them."""
    return [
        *(
            InputTrial(
                _ITEM,
                f"a model {does}",
                _misbehave,
                ends(reason, code),
                Arrangement(model=Misbehaviour(once=text), drives=True),
            )
            for does, text, code, reason in _ENDS
        ),
        *(
            InputTrial(
                _ITEM,
                f"a model {does}",
                _misbehave,
                falls(reason, within_s),
                Arrangement(model=Misbehaviour(always=text)),
            )
            for does, text, reason, within_s in _FAULTS
        ),
        InputTrial(
            _ITEM,
            "a model prints 100 lines in every step",
            _misbehave,
            balances("more lines"),
            Arrangement(model=Misbehaviour(always="print('a line\\n' * 100)")),
            look_s=3.0,
        ),
    ]
