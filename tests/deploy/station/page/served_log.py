# SPDX-License-Identifier: MIT
"""The page that plays a log, served in a thread of its own to a browser of the test."""

import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from segway_ecc.deploy.station.web.log_server import serve_log
from segway_ecc.deploy.station.web.site_address import bind, site_address_of
from tests.patience import PATIENCE_S


@contextmanager
def served_log(path: Path) -> Iterator[str]:
    """The address of the page, without a moment."""
    sockets = bind("127.0.0.1", 0)
    place = site_address_of(sockets, "http", [])
    ready = threading.Event()
    ends: list[object] = []

    @contextmanager
    def stoppable(end: object) -> Iterator[None]:
        ends.append(end)
        yield

    thread = threading.Thread(target=serve_log, args=(path, sockets, place, stoppable, ready.set), daemon=True)
    thread.start()
    assert ready.wait(PATIENCE_S)
    try:
        yield f"http://127.0.0.1:{place.port}/log#log={path.name}"
    finally:
        for end in ends:
            assert callable(end)
            end("the test")
        thread.join(PATIENCE_S)
        for bound in sockets:
            with contextlib.suppress(OSError):
                bound.close()
