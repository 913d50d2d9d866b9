"""Messages for people, on standard error, written by a thread of their own so that no terminal can hold up the loop."""

import contextlib
import logging
import logging.handlers
import queue
from collections.abc import Iterator


@contextlib.contextmanager
def messages() -> Iterator[None]:
    """Send every warning and notice to standard error until the context is left."""
    pending: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    shown = logging.StreamHandler()
    shown.setFormatter(logging.Formatter("segway-ecc: %(message)s"))
    listener = logging.handlers.QueueListener(pending, shown)
    handler = logging.handlers.QueueHandler(pending)
    root = logging.getLogger()
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    logging.getLogger("can").setLevel(logging.ERROR)
    listener.start()
    try:
        yield
    finally:
        listener.stop()
        root.removeHandler(handler)
        root.setLevel(level)
