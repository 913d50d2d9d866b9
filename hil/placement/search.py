# SPDX-License-Identifier: MIT
"""How bad a network balance control on the station tolerates, by bisection."""

import enum
from collections.abc import Sequence
from typing import Final

import msgspec

from segway_ecc.hil.placement.bench import START_S, PlacementRun, run
from segway_ecc.hil.placement.judging import RunRecord, reason_of
from segway_ecc.hil.placement.network import Delivery, Network, Partition
from segway_ecc.hil.placement.results import Bound, Placement, Site
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

AWAY: Final = Placement(sequence=Site.ROBOT, balance=Site.STATION, supervision=Site.ROBOT)
NUDGE_N: Final = 10.0
"""For 0.1 s: as `segway-ecc design margins` nudges."""
_REST: Final = Manoeuvre(segments=(Segment(duration=1.0),))
_BEGINS_S: Final = START_S - 1.0
_GROWS_S: Final = 1.8
"""It grows to its size before the nudge, so that no gap between messages looks like a lost bus."""
_CUT_AT_S: Final = START_S + 3.0
_UNTIL_S: Final = START_S + 7.0


@enum.unique
class Size(enum.Enum):
    """What is made larger; each with its unit, the largest tried and how closely the limit is found."""

    DELAY = ("delay there and back, together", "s", 0.128, 0.001)
    STANDING = ("delay there and back, together, from before it stands up", "s", 0.128, 0.001)
    JITTER = ("jitter", "s", 0.032, 0.00025)
    LOSS = ("loss, each way", "1", 0.64, 0.005)
    PARTITION = ("partition", "s", 0.256, 0.001)


_ORDERED: Final = (Size.JITTER, Size.LOSS)
"""Where it matters what becomes of messages that are lost or overtaken."""


class LimitSearch(msgspec.Struct, frozen=True, kw_only=True):
    """A search.

    Attributes:
        size: What is made larger.
        delivery: What becomes of messages that are lost or overtaken.
        theory: What theory gives for the limit; None where it gives nothing.
    """

    robot: str
    size: Size
    delivery: Delivery = Delivery.NEWEST
    theory: float | None = None


def find(search: LimitSearch, seeds: Sequence[int], resolution: float | None = None) -> Bound:
    """The most that is tolerated, by bisection: less than what is tolerated is taken to be tolerated too."""
    what, unit, most, finest = search.size.value

    def lost_with(size: float) -> str | None:
        job = PlacementRun(
            robot=search.robot,
            placement=AWAY,
            manoeuvre=_REST,
            until_s=_UNTIL_S,
            network=_network(search, size),
            pushed_n=NUDGE_N,
            delivery=search.delivery,
            until_fallen=True,
        )
        return _lost_by([run(msgspec.structs.replace(job, seed=seed)) for seed in seeds])

    tolerated, lost, lost_by = 0.0, most, lost_with(most)
    if lost_by is None:
        tolerated = most
    while lost - tolerated > (resolution or finest):
        middle = 0.5 * (tolerated + lost)
        by = lost_with(middle)
        if by is None:
            tolerated = middle
        else:
            lost, lost_by = middle, by
    return Bound(
        robot=search.robot,
        what=f"{what}, {search.delivery}" if search.size in _ORDERED else what,
        unit=unit,
        tolerated=tolerated,
        lost=None if lost_by is None else lost,
        lost_by=lost_by or "",
        theory=search.theory,
    )


def _lost_by(runs: Sequence[RunRecord]) -> str | None:
    """Why balance was lost in the first run in which it was; None where in none."""
    for seen in runs:
        if seen.fell_s(START_S) is not None or not seen.is_calm_at_the_end:
            return reason_of(seen) or ("it shakes" if seen.changes else "it never arms")
    return None


def _network(search: LimitSearch, size: float) -> Network:
    growing = Network(begins_s=_BEGINS_S, grows_s=_GROWS_S)
    match search.size:
        case Size.DELAY:
            return msgspec.structs.replace(growing, latency_s=0.5 * size)
        case Size.STANDING:
            return Network(latency_s=0.5 * size)
        case Size.JITTER:
            # around as much latency as itself
            return msgspec.structs.replace(growing, latency_s=size, jitter_s=size)
        case Size.LOSS:
            return msgspec.structs.replace(growing, loss=size)
        case Size.PARTITION:
            return msgspec.structs.replace(growing, partitions=(Partition(_CUT_AT_S, size),))
