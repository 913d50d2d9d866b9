# SPDX-License-Identifier: MIT
"""What the command does before it imports anything: let Ctrl-C end it at once, without a traceback.

So this imports nothing either, not even `signal`: it brings `enum` and ten more.
"""

import _signal  # type: ignore[import-not-found]  # typeshed has it as `signal` alone

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

_INTERRUPTED = 130


def end_by_interrupt() -> bool:
    """Have Ctrl-C end this process at once; false where whoever started us wants it otherwise."""
    is_ours = bool(_signal.getsignal(_signal.SIGINT) is _signal.default_int_handler)
    if is_ours:
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    return is_ours


def run_imported(main: "Callable[[], int]", *, is_ours: bool) -> int:
    """Run the command, which from here on takes Ctrl-C itself as it needs, where `end_by_interrupt` was true."""
    try:
        if is_ours:
            _signal.signal(_signal.SIGINT, _signal.default_int_handler)
        return main()
    except KeyboardInterrupt:
        return _INTERRUPTED
