# SPDX-License-Identifier: MIT
"""The health check of the service that was started."""

import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Final

from segway_ecc.deploy.station.installer.rendering import STATION
from segway_ecc.deploy.station.installer.settings import InstallSettings
from segway_ecc.node.errors import NodeError

_NS_PER_S: Final = 1_000_000_000
_PAUSE_S: Final = 0.2
_ANSWER_S: Final = 3.0
_EVERYWHERE: Final = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104 - compared, not bound


def wait_until_healthy(
    settings: InstallSettings,
    timeout_ns: int,
    now_ns: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Poll `GET /health` until the answer is `ok`.

    Raises:
        NodeError: It is not within `timeout_ns`; with the last problem and where to look.
    """
    end_ns = now_ns() + timeout_ns
    host = _EVERYWHERE.get(settings.address, settings.address)
    address = f"{settings.scheme}://{f'[{host}]' if ':' in host else host}:{settings.port}/health"
    while (problem := _problem(address)) is not None:
        if now_ns() >= end_ns:
            within = f"within {timeout_ns / _NS_PER_S:g} s"
            raise NodeError(
                f"the station is installed, but its health check did not pass {within} ({problem}); "
                f"see journalctl --unit {STATION} --lines 20"
            )
        sleep(_PAUSE_S)


def _problem(address: str) -> str | None:
    """Why the health check fails, or None where it passes."""
    # No proxy, and no check of the certificate: it is for the name that browsers use, and we use the address.
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    handlers = (urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=context))
    try:
        with urllib.request.build_opener(*handlers).open(address, timeout=_ANSWER_S) as answer:
            content = answer.read(100)
    except urllib.error.HTTPError as error:
        error.close()
        return f"it answered {error.code}"
    except (OSError, ValueError) as error:
        return str(getattr(error, "reason", error))
    return None if content == b"ok\n" else "something else answered"
