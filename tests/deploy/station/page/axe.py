# SPDX-License-Identifier: MIT
"""What axe-core finds wrong with a page, for people who use a screen reader, a keyboard or weak eyes."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from playwright.sync_api import Page

_SOURCE: Final = Path(__file__).parents[3] / "vendor" / "axe-core" / "axe.min.js"


def violations(page: "Page") -> list[str]:
    """Each rule that is violated, with where; none of a page that all can use."""
    page.evaluate(_SOURCE.read_text(encoding="utf-8"))
    found: list[str] = page.evaluate(
        """async () => (await axe.run()).violations.flatMap(({id, help, nodes}) => nodes.map(
            (node) => `${id} (${help}): ${node.target.join(" ")}: ${node.failureSummary.replaceAll("\\n", " ")}`))"""
    )
    return found
