# SPDX-License-Identifier: MIT
"""Waiting for what the page shows; nothing here sleeps as a proof."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page


def there(page: "Page", selector: str) -> None:
    """Wait until an element that a selector names can be seen; looks at each frame, playwright ever more rarely."""
    page.wait_for_function(
        """(selector) => [...document.querySelectorAll(selector)].some((element) => {
            const box = element.getBoundingClientRect();
            return element.checkVisibility({visibilityProperty: true}) && box.width > 0 && box.height > 0; })""",
        arg=selector,
    )


def shows(page: "Page", selector: str, text: str) -> None:
    """Wait until an element that can be seen holds a text."""
    page.wait_for_function(
        """([selector, text]) => [...document.querySelectorAll(selector)].some(
            (element) => element.checkVisibility() && element.innerText.includes(text))""",
        arg=[selector, text],
    )


def shows_like(page: "Page", selector: str, pattern: str) -> None:
    """Wait until an element that can be seen holds what a pattern describes: an age grows while a machine stalls."""
    page.wait_for_function(
        """([selector, pattern]) => [...document.querySelectorAll(selector)].some(
            (element) => element.checkVisibility() && new RegExp(pattern).test(element.innerText))""",
        arg=[selector, pattern],
    )


def tells(page: "Page", selector: str, text: str) -> None:
    """Wait until an element holds a text, be it only for a screen reader."""
    page.wait_for_function(
        "([selector, text]) => document.querySelector(selector).textContent.includes(text)", arg=[selector, text]
    )


def gone(page: "Page", selector: str) -> None:
    """Wait until an element cannot be seen."""
    page.wait_for_function(
        "(selector) => ![...document.querySelectorAll(selector)].some((element) => element.checkVisibility())",
        arg=selector,
    )


def drawn(page: "Page") -> None:
    """Wait until the page has drawn all that it knows now: plots are drawn every 100 ms at most, by its own clock."""
    page.evaluate(
        """async () => {
        await new Promise((done) => setTimeout(done, 300));
        for (let frame = 0; frame < 2; frame += 1) await new Promise(requestAnimationFrame); }"""
    )


def press(page: "Page", act: str) -> None:
    """Click the button of a command, be it disabled: then it is to say why."""
    press_any(page, f"[data-act={act}]")


def press_any(page: "Page", selector: str) -> None:
    """Click what a selector names, be it disabled."""
    page.click(selector, force=True)


def loaded(page: "Page") -> None:
    """Wait until the page shows a picture whose age it knows: before, it commands nothing."""
    there(page, "body[data-fresh=true]")
    there(page, "#robot:not([hidden])")


def load_again(page: "Page") -> None:
    """Load the page anew, and wait for its first picture."""
    page.reload()
    loaded(page)
