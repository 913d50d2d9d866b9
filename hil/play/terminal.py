# SPDX-License-Identifier: MIT
"""The process at the terminal: argument DESCRIPTOR, the other end of the loop's socket.

It is a process of its own so that neither drawing nor a terminal that hangs can delay the loop.
"""

import contextlib
import os
import select
import signal
import socket
import sys
import termios
import tty
from collections.abc import Iterator
from typing import Final

from rich.console import Console
from rich.live import Live

from segway_ecc.hil.play.channel import TerminalEnd
from segway_ecc.hil.play.keys import Key, keys_in
from segway_ecc.hil.play.view import picture

_DRAW_EVERY_S: Final = 0.1


@contextlib.contextmanager
def raw(descriptor: int) -> Iterator[None]:
    """Have keys at once and unseen, Ctrl-C as a key; put the terminal back when the context is left."""
    before = termios.tcgetattr(descriptor)
    tty.setraw(descriptor)
    changed = termios.tcgetattr(descriptor)
    changed[1] = before[1]  # what is drawn still needs its line ends made
    termios.tcsetattr(descriptor, termios.TCSADRAIN, changed)
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def serve(end: TerminalEnd, descriptor: int, console: Console) -> None:
    """Draw and send keys until the loop, or the terminal, is gone."""
    newest = None
    with raw(descriptor), Live(console=console, screen=True, auto_refresh=False) as live:
        while not end.is_gone:
            if select.select([descriptor], [], [], _DRAW_EVERY_S)[0]:
                data = os.read(descriptor, 1024)
                if not data:
                    return
                for key in keys_in(data):
                    end.press(key)
            end.press(Key.ALIVE)
            newest = end.newest() or newest
            live.update(picture(newest), refresh=True)


def main() -> int:
    """Run as a process; it ends with the loop, so signals are left to the loop."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with socket.socket(fileno=int(sys.argv[1])) as end, contextlib.suppress(OSError):
        end.setblocking(False)  # noqa: FBT003 - the standard library's signature
        serve(TerminalEnd(end), sys.stdin.fileno(), Console())
    return 0


if __name__ == "__main__":
    sys.exit(main())
