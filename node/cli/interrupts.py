# SPDX-License-Identifier: MIT
"""Ctrl-C while a command starts."""

import contextlib
import signal
from collections.abc import Iterator


@contextlib.contextmanager
def ends_at_once() -> Iterator[None]:
    """Let Ctrl-C end the process at once, as SIGTERM does, while nothing is on that would have to be switched off.

    Python makes an exception of it in the middle of whatever runs, and what runs may swallow it: imports did, and
    decoding in C. A robot that was asked to stop then ran on. Inside, a command may take its signals itself.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:  # whoever started us wants it otherwise
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
