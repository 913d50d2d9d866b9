# SPDX-License-Identifier: MIT
"""The limits against friction as a table and as a figure, with what no controller can."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from segway_ecc.hil.figure import png
from segway_ecc.hil.floor.least_friction import RisingLimit
from segway_ecc.hil.floor.margins import STAND_UP, FloorLimit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS: Final = 3
_STYLES: Final = (("#2e6f9e", "o"), ("#b3261e", "s"))
_LEGEND: Final = "dotted: required; triangle: no more was tried; dashed: on less no torque raises it from its bumper"
_GREY: Final = "#6b6b6b"


def table(limits: Sequence[FloorLimit], frictions: Sequence[float]) -> list[tuple[str, ...]]:
    """The table: a disturbance in each row, a friction in each column; `!` where less is tolerated than required."""
    found = {(limit.name, limit.friction): limit for limit in limits}
    head = ("disturbance", "unit", *(f"at {friction:g}" for friction in frictions), "required", "least friction")
    lines: list[tuple[str, ...]] = [head]
    for name in dict.fromkeys(limit.name for limit in limits):
        across = [found[name, friction] for friction in frictions]
        least = found.get((name, None))
        required = next((limit.required for limit in across if limit.required is not None), None)
        is_stand_up = name.startswith(STAND_UP)
        lines.append(
            (
                name,
                "" if is_stand_up else across[0].unit,
                *map(_cell, across),
                "yes" if is_stand_up else "-" if required is None else f"{required:.3g}",
                "" if least is None else "none" if least.tolerated is None else f"{least.tolerated:.2f}",
            )
        )
    return lines


def _cell(limit: FloorLimit) -> str:
    mark = "" if limit.is_enough else " !"
    if limit.name.startswith(STAND_UP):
        return f"{'no' if limit.tolerated is None else 'yes'}{mark}"
    if limit.tolerated is None:
        return f"falls{mark}"
    return f"{'> ' if limit.is_beyond else ''}{limit.tolerated:.3g}{mark}"


def beyond_hardware(limit: RisingLimit, torque_limit: float) -> str:
    """What no controller can, in a line; `torque_limit` is what the drive lets one wheel have, N m."""
    verdict = "which it has" if torque_limit >= limit.torque else "WHICH IT HAS NOT"
    return (
        f"beyond the hardware: on a friction below {limit.friction:.3f} no torque raises it from its bumper; "
        f"there it takes {limit.torque:.2f} N m of each wheel, of {torque_limit:.2f} N m, {verdict}"
    )


def draw(limits: Sequence[FloorLimit], least: float, title: str) -> Mapping[str, bytes]:
    """The figure, by the name of its file; `least` is the friction below which it cannot rise."""
    panels = _panels(limits)
    count = -(-len(panels) // _COLUMNS)

    def drawn(figure: "Figure") -> None:
        figure.suptitle(f"{title}\n{_LEGEND}", fontsize=10)
        axes = figure.subplots(count, _COLUMNS, squeeze=False).flatten()
        for axis, (name, shown) in zip(axes, panels.items(), strict=False):
            _draw_panel(axis, name, shown, least)
        for axis in axes[len(panels) :]:
            axis.set_visible(False)

    return {"margins.png": png((11.0, 0.8 + 2.7 * count), drawn)} if panels else {}


def _panels(limits: Sequence[FloorLimit]) -> Mapping[str, Mapping[str, Sequence[FloorLimit]]]:
    """By what a panel shows, its curves: both directions of a disturbance are in one."""
    panels: dict[str, dict[str, list[FloorLimit]]] = {}
    for limit in limits:
        if limit.friction is None:
            continue
        words = limit.name.replace(",", "").split()
        way = next((word for word in words if word in {"ahead", "back", "up", "down", "more", "less"}), "")
        if limit.name.startswith(STAND_UP):
            way = words[1]
            title = STAND_UP
        else:
            title = " ".join(word for word in words if word != way)
        panels.setdefault(title, {}).setdefault(way, []).append(limit)
    return panels


def _draw_panel(axis: "Axes", name: str, shown: Mapping[str, Sequence[FloorLimit]], least: float) -> None:
    axis.set_title(name, fontsize=10)
    for (colour, marker), (way, curve) in zip(_STYLES, shown.items(), strict=False):
        frictions = [limit.friction or 0.0 for limit in curve]
        values = [abs(limit.tolerated or 0.0) for limit in curve]
        axis.plot(frictions, values, marker=marker, label=way or None, color=colour, fillstyle="none", linewidth=1.2)
        beyond = [(f, value) for f, value, limit in zip(frictions, values, curve, strict=True) if limit.is_beyond]
        if beyond:
            axis.plot(
                *zip(*beyond, strict=True), marker="^", markersize=11, linestyle="", color=colour, fillstyle="none"
            )
        required = curve[0].required
        if required is not None and not name.startswith(STAND_UP):
            axis.axhline(abs(required), color=_GREY, linestyle=":", linewidth=1.0)
    axis.axvline(least, color=_GREY, linestyle="--", linewidth=1.0)
    axis.set_ylim(0.0, 1.1 * axis.get_ylim()[1])
    if name.startswith(STAND_UP):
        axis.set_yticks([0.0, 1.0], ["no", "yes"])
    else:
        axis.set_ylabel(next(iter(shown.values()))[0].unit)
    axis.set_xlabel("friction of both tyres")
    axis.grid(visible=True, alpha=0.3)
    if any(shown):
        axis.legend(fontsize=8)
