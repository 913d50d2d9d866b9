# SPDX-License-Identifier: MIT
"""Figures that a command draws."""

from typing import TYPE_CHECKING, Any

import pytest

from segway_ecc.node.cli import panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> "list[Figure]":
    """What is drawn from now on."""
    figures: list[Figure] = []
    draw = panels.drawing

    def keep(*what: Any) -> "Figure | None":
        figure = draw(*what)
        if figure is not None:
            figures.append(figure)
        return figure

    monkeypatch.setattr(panels, "drawing", keep)
    return figures
