# SPDX-License-Identifier: MIT
"""Files that several verbs write: CSV and drawings."""

import csv
import importlib.util
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from segway_ecc.node.errors import ConfigurationError


class Curve(NamedTuple):
    """Values over time; without a label it has no legend."""

    values: Sequence[float]
    label: str | None = None
    width: float = 1.5


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table.

    Raises:
        ConfigurationError: The file cannot be written.
    """
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(rows)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error


def draw_panels(path: Path, times: Sequence[float], panels: Sequence[tuple[str, Sequence[Curve]]]) -> None:
    """Draw curves over time, s, one panel below the other; the file's name ends in its format.

    Args:
        path: The file.
        times: Of every curve.
        panels: The label of each panel, and its curves.

    Raises:
        ConfigurationError: There is no drawing library, or the file cannot be written.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigurationError("--plot needs a drawing library: install 'segway-ecc[report]'")
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra that everything else does without

    figure = Figure(figsize=(8, 1.2 + 1.8 * len(panels)), layout="constrained")
    axes = figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (label, curves) in zip(axes, panels, strict=False):
        for curve in curves:
            panel.plot(times, curve.values, linewidth=curve.width, label=curve.label)
        panel.set_ylabel(label)
        panel.grid(visible=True)
        if any(curve.label for curve in curves):
            panel.legend()
    axes[-1].set_xlabel("time, s")
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"cannot draw {path}: {error}") from error
