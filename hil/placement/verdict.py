# SPDX-License-Identifier: MIT
"""Which placements are fit for a network, and which one is recommended."""

from typing import Final, NamedTuple

from segway_ecc.hil.placement.judging import UPRIGHT, RunOutcome
from segway_ecc.hil.placement.placement import Site
from segway_ecc.hil.placement.results import Row, StudyResult

POSITION_M: Final = 0.1
"""Farther than that from where it is with everything on the robot, a placement does not follow its set-points."""
STOP_S: Final = 0.5
"""A stop that takes longer to zero torque is none."""


class Choice(NamedTuple):
    """A placement with the way its set-points travel."""

    sequence: str
    balance: str
    supervision: str
    setpoints: str

    def __str__(self) -> str:
        """Who is where, in words."""
        places = ((name, getattr(self, name)) for name in ("sequence", "balance", "supervision"))
        away = [name for name, place in places if place == Site.STATION]
        where = f"{' and '.join(away)} on the station" if away else "all on the robot"
        return f"{where}, {self.setpoints}" if self.setpoints else where


def choice_of(row: Row) -> Choice:
    """Which choice a row is of."""
    return Choice(row.sequence, row.balance, row.supervision, row.setpoints)


def choices(found: StudyResult) -> list[Choice]:
    """All that were studied, in their order."""
    return list(dict.fromkeys(choice_of(row) for row in found.drives))


def unfit(found: StudyResult, choice: Choice, network: str) -> list[str]:
    """What speaks against a choice on a network; empty where it is fit."""
    reasons = []
    for drive in (row for row in found.drives if choice_of(row) == choice and row.network == network):
        if drive.outcome is not RunOutcome.DROVE_ON:
            reasons.append(drive.outcome.value)
        elif drive.max_position_m > POSITION_M:
            reasons.append(f"{drive.max_position_m:.2f} m off")
    # On the stop, the kind of set-points has no influence.
    stop = next((row for row in found.stops if row.placement == choice[:3] and row.network == network), None)
    if stop is not None and (stop.worst_s is None or stop.worst_s > STOP_S) and stop.outcome in UPRIGHT:
        reasons.append("no stop" if stop.worst_s is None else f"stops after {stop.worst_s:.2f} s")
    reasons += [
        f"falls in a partition of {cut.partition_s:g} s"
        for cut in found.cuts
        if choice_of(cut) == choice and cut.outcome not in UPRIGHT
    ][:1]
    return reasons


def recommended(found: StudyResult, network: str) -> Choice | None:
    """Of those that are fit, the one with the most on the station; then with the supervision there, where people are.

    None where none is fit.
    """
    fit = [choice for choice in choices(found) if not unfit(found, choice, network)]
    return max(fit, key=_rank, default=None)


def overall(found: StudyResult) -> Choice | None:
    """The choice that is fit on the most networks, and of several the one that would be recommended."""
    networks = network_names(found)
    ranked = {c: sum(not unfit(found, c, network) for network in networks) for c in choices(found)}
    best = max(ranked, key=lambda choice: (ranked[choice], _rank(choice)), default=None)
    return best if best is not None and ranked[best] else None


def network_names(found: StudyResult) -> list[str]:
    """The networks on which was driven, in their order."""
    return list(dict.fromkeys(row.network for row in found.drives))


def _rank(choice: Choice) -> tuple[int, bool, bool]:
    places = (choice.sequence, choice.balance, choice.supervision)
    away = sum(place == Site.STATION for place in places)
    return away, choice.supervision == Site.STATION, choice.setpoints.endswith("stamped")
