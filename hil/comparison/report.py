# SPDX-License-Identifier: MIT
"""A comparison as a table, as JSON, as a drawing and as a page."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from segway_ecc.hil.comparison.compare import Comparison, Residual
from segway_ecc.hil.comparison.logged import Array
from segway_ecc.hil.figure import image
from segway_ecc.hil.page import figure, page, pairs, section, table, table_row
from segway_ecc.hil.text_table import aligned

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEAD: Final = ("signal", "unit", "RMS", "largest", "at, s", "mean", "of spread", "of noise")
_TITLE: Final = "A run beside its simulation"
_LOGGED: Final = "#2e6f9e"
_SIMULATED: Final = "#b3261e"
_DEGREES: Final = 180.0 / math.pi


def text(found: Comparison) -> str:
    """The table, below what was compared, for a terminal."""
    facts = "".join(f"{name}: {value}\n" for name, value in _facts(found).items())
    rows = [_HEAD, *(_row(residual) for residual in found.residuals)]
    return facts + "\n" + "".join(f"{line}\n" for line in aligned(rows, left=2))


def document(found: Comparison) -> dict[str, object]:
    """The same for machines."""
    return {
        "robot": found.run.file.name,
        "plant": found.plant,
        "cycles": _cycles(found),
        "windows": len(found.pieces),
        "window_s": found.window_s,
        "begins_as_logged": found.begins_as_logged,
        "delay_s": found.delay_s,
        "pitch_offset_rad": found.pitch_offset,
        "signals": [
            {
                "name": each.name,
                "unit": each.unit,
                "rms": each.rms,
                "largest": each.largest,
                "largest_at_s": each.largest_at_s,
                "mean": each.mean,
                "spread": each.spread,
                "noise": each.noise,
                "rms_per_spread": each.relative,
                "rms_per_noise": None if not each.noise else each.rms / each.noise,
            }
            for each in found.residuals
        ],
        "damage": list(found.run.damage),
    }


def curves(found: Comparison) -> tuple[Array, list[tuple[str, str, Array, Array]]]:
    """Times, s, and of each signal its name, its unit, what was logged and what was simulated, to be drawn."""
    places = _drawn(found)
    drawn = [
        (each.name, each.unit, found.run.values[each.name][places], _broken(found, each)[places])
        for each in found.residuals
    ]
    return found.run.starts[places], drawn


def render(found: Comparison) -> str:
    """The page: what was compared, the table, and a figure for each signal."""
    rows = (table_row(_row(residual)) for residual in found.residuals)
    sections = [
        section("What was compared", pairs(_facts(found))),
        section("Residuals", table("Residuals by signal: logged less simulated", _HEAD, rows)),
        section("Signals", "".join(_figures(found))),
    ]
    introduction = f"The commands of a run of {found.run.file.name}, given to {found.plant}: {_begins(found)}."
    return page(_TITLE, introduction, sections)


def _figures(found: Comparison) -> Iterator[str]:
    for each in found.residuals:

        def draw(canvas: "Figure", each: Residual = each) -> None:
            _draw(canvas, found, each)

        caption = f"{each.name}: RMS residual {each.rms:.3g} {each.unit}"
        yield figure(caption, image(each.name, caption, (9.0, 3.4), draw))


def _draw(canvas: "Figure", found: Comparison, each: Residual) -> None:
    places = _drawn(found)
    times, logged, simulated = found.run.starts[places], found.run.values[each.name], _broken(found, each)
    upper, lower = canvas.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    upper.plot(times, logged[places], color=_LOGGED, linewidth=2.0, label="logged")
    upper.plot(times, simulated[places], color=_SIMULATED, linewidth=1.0, label="simulated")
    upper.set_ylabel(each.unit)
    upper.legend(loc="upper right")
    lower.plot(times, (logged - simulated)[places], color="black", linewidth=0.8)
    lower.set_ylabel("residual")
    lower.set_xlabel("time, s")
    for panel in (upper, lower):
        panel.grid(visible=True)


def _drawn(found: Comparison) -> slice:
    """The cycles from the first that was simulated to the last."""
    return slice(found.pieces[0].first, found.pieces[-1].end)


def _broken(found: Comparison, each: Residual) -> Array:
    """A simulated signal with a gap before each piece, so that no line joins what does not belong together."""
    simulated = np.array(found.simulated[each.name])
    simulated[[piece.first for piece in found.pieces[1:]]] = np.nan
    return simulated


def _facts(found: Comparison) -> dict[str, str]:
    seconds = _cycles(found) * found.run.period_s
    facts = {
        "robot": found.run.file.name,
        "plant": found.plant,
        "compared": f"{_cycles(found)} cycles, {seconds:.2f} s, {_begins(found)}",
        "delay of the commands": f"{found.delay_s * 1e3:g} ms",
    }
    if found.pitch_offset:
        angle = f"{found.pitch_offset:.4f} rad ({found.pitch_offset * _DEGREES:.2f} degrees)"
        facts["pitch at the beginnings"] = f"{angle} further than logged: the IMU is off, or the centre of mass"
    return facts


def _begins(found: Comparison) -> str:
    if not found.begins_as_logged:
        return "in one, from where the plant always begins"
    if found.window_s is None:
        return f"in {len(found.pieces)} whole stretches, each from the logged motion"
    return f"in {len(found.pieces)} windows of {found.window_s:g} s, each from the logged motion"


def _cycles(found: Comparison) -> int:
    return sum(piece.end - piece.first for piece in found.pieces)


def _row(each: Residual) -> Sequence[str]:
    return (
        each.name,
        each.unit,
        f"{each.rms:.3g}",
        f"{each.largest:.3g}",
        f"{each.largest_at_s:.2f}",
        f"{each.mean:.2g}",
        f"{100.0 * each.relative:.3g} %" if math.isfinite(each.relative) else "-",
        "-" if not each.noise else f"times {each.rms / each.noise:.3g}",
    )
