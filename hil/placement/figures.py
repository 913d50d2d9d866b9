"""The placement study's figures, each as an image inside the page."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from segway_ecc.hil.figure import image
from segway_ecc.hil.placement.judging import UPRIGHT
from segway_ecc.hil.placement.results import Bound, Drive, Stop, StudyResult
from segway_ecc.hil.placement.verdict import POSITION_M, STOP_S, Choice, choice_of, choices, network_names

_BAD: Final = "#b3261e"
_GOOD: Final = "#2e6f9e"
_GREY: Final = "#6b6b6b"
_PALE: Final = "#f3d6d3"
_FLOOR_M: Final = 1e-3
"""Distances below this stand at the foot of the logarithmic axis, m."""


def distances(found: StudyResult) -> str:
    """How far off each choice is on each network."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        _grid(axes, network_names(found), choices(found))
        for drive in found.drives:
            _draw_distance(axes, drive, found)

    label = "Each placement on each network: how far from the robot with all control on board, or that it fell"
    return image("distances", label, (11.0, 5.4), draw)


def stops(found: StudyResult) -> str:
    """How long each stop took."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        names = network_names(found)
        for place, (title, chosen) in enumerate(_stop_groups(found.stops)):
            times = {s.network: s.worst_s for s in chosen}
            ends = [(names.index(n) + 0.27 * (place - 1), t * 1e3) for n, t in times.items() if t is not None]
            if ends:
                axes.bar([x for x, _ in ends], [ms for _, ms in ends], width=0.25, label=title)
        axes.axhline(STOP_S * 1e3, color=_BAD, linewidth=1, linestyle="--")
        axes.set_xticks(range(len(names)), names, rotation=20, ha="right")
        axes.set_ylabel("from stop to zero torque, ms")
        if axes.patches:
            axes.legend(frameon=False)

    return image("stops", "From pressing stop to zero torque on each network", (9.5, 4.2), draw)


def bounds(found: StudyResult) -> str:
    """What balance control on the station bears, where it is a time."""
    times = [bound for bound in found.bounds if bound.unit == "s"]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for place, bound in enumerate(times):
            _draw_bound(axes, place, bound)
        axes.set_yticks(range(len(times)), [f"{b.robot}: {b.what}" for b in times])
        axes.invert_yaxis()
        axes.set_xlabel("ms; the mark is the delay margin of the design")

    return image("bounds", "What balance control on the station bears", (9.5, 1.2 + 0.5 * len(times)), draw)


def _grid(axes: Axes, networks: Sequence[str], shown: Sequence[Choice]) -> None:
    axes.set_xlim(-0.5, len(networks) - 0.5)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_xticks(range(len(networks)), networks, rotation=20, ha="right")
    axes.set_yticks(range(len(shown)), [str(choice) for choice in shown])
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


def _draw_distance(axes: Axes, drive: Drive, found: StudyResult) -> None:
    x, y = network_names(found).index(drive.network), choices(found).index(choice_of(drive))
    is_up = drive.outcome in UPRIGHT
    text = f"{drive.max_position_m * 1e3:.0f} mm" if is_up else drive.outcome.value.replace(" ", "\n", 1)
    is_bad = not is_up or drive.max_position_m > POSITION_M
    share = min(max(drive.max_position_m, _FLOOR_M) / POSITION_M, 1.0)
    colour = _PALE if is_bad else (1.0 - 0.35 * share, 1.0 - 0.18 * share, 1.0)
    axes.fill_between([x - 0.48, x + 0.48], y - 0.46, y + 0.46, color=colour, linewidth=0)
    axes.annotate(text, (x, y), ha="center", va="center", fontsize=7.5, color=_BAD if is_bad else "#111111")


def _stop_groups(stops: Sequence[Stop]) -> list[tuple[str, list[Stop]]]:
    """Those over the same flows."""
    groups: dict[str, list[Stop]] = {
        "nothing crosses the network": [],
        "the stop crosses it": [],
        "the commands cross it": [],
    }
    none, stop, commands = groups.values()
    for row in stops:
        if row.sequence != row.balance:
            continue
        (commands if row.balance == "station" else stop if row.supervision == "station" else none).append(row)
    return list(groups.items())


def _draw_bound(axes: Axes, place: int, bound: Bound) -> None:
    axes.barh(place, bound.borne * 1e3, height=0.6, color=_GOOD)
    if bound.theory is not None:
        axes.plot([bound.theory * 1e3] * 2, [place - 0.4, place + 0.4], color=_BAD, linewidth=2)
    axes.annotate(
        f"{bound.borne * 1e3:.4g}",
        (bound.borne * 1e3, place),
        (4, 0),
        textcoords="offset points",
        va="center",
        color=_GREY,
    )
