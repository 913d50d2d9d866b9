# SPDX-License-Identifier: MIT
"""The browser in which pages are tested."""

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from tests.patience import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser

OPTIONS: Final[dict[str, Any]] = {
    "executable_path": "/usr/bin/chromium",
    "args": ["--no-sandbox"],
    "timeout": PATIENCE_S * 1e3,
}
"""With which it is launched."""


@contextlib.contextmanager
def chromium() -> "Iterator[Browser]":
    """It runs while the context lasts; nothing else in this process can run an event loop meanwhile."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - it may not be there

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(**OPTIONS)
        yield browser
        browser.close()
