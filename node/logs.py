# SPDX-License-Identifier: MIT
"""Messages for people.

On standard error they are written by a thread of their own, so that no terminal can hold up the loop.
"""

import contextlib
import logging
import logging.handlers
import queue
from collections.abc import Iterator


@contextlib.contextmanager
def messages_to(handler: logging.Handler) -> Iterator[None]:
    """Hand every warning and notice to `handler` until the context is left."""
    root = logging.getLogger()
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    logging.getLogger("can").setLevel(logging.ERROR)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(level)


@contextlib.contextmanager
def messages() -> Iterator[None]:
    """Send every warning and notice to standard error until the context is left."""
    pending: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    shown = logging.StreamHandler()
    shown.setFormatter(logging.Formatter("segway-ecc: %(message)s"))
    listener = logging.handlers.QueueListener(pending, shown)
    with messages_to(logging.handlers.QueueHandler(pending)):
        listener.start()
        try:
            yield
        finally:
            listener.stop()
