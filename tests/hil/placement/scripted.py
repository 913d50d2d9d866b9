# SPDX-License-Identifier: MIT
"""What a study might have found, made by hand."""

from segway_ecc.hil.placement.judging import RunOutcome
from segway_ecc.hil.placement.results import Bound, Cut, Drive, Site, Stop, StudyResult

R, S = Site.ROBOT, Site.STATION
Places = tuple[Site, Site, Site]


def drive(
    places: Places,
    network: str = "n",
    setpoints: str = "",
    outcome: RunOutcome = RunOutcome.DROVE_ON,
    off_m: float = 0.01,
) -> Drive:
    sequence, balance, supervision = places
    return Drive(
        sequence=sequence,
        balance=balance,
        supervision=supervision,
        network=network,
        setpoints=setpoints,
        outcome=outcome,
        reason="",
        max_position_m=off_m,
        rms_position_m=0.5 * off_m,
        max_velocity_m_s=0.25,
        rms_velocity_m_s=0.125,
        max_tilt_rad=0.375,
        digest="d",
    )


def stop(
    places: Places,
    *zero_s: float | None,
    network: str = "n",
    setpoints: str = "",
    outcome: RunOutcome = RunOutcome.DROVE_ON,
) -> Stop:
    sequence, balance, supervision = places
    return Stop(
        sequence=sequence,
        balance=balance,
        supervision=supervision,
        network=network,
        setpoints=setpoints,
        zero_s=zero_s,
        outcome=outcome,
    )


def cut(places: Places, outcome: RunOutcome, setpoints: str = "", partition_s: float = 2.0) -> Cut:
    sequence, balance, supervision = places
    return Cut(
        sequence=sequence,
        balance=balance,
        supervision=supervision,
        network="wired",
        setpoints=setpoints,
        partition_s=partition_s,
        outcome=outcome,
        did="+0.50 s HOLD <here>",
        max_position_m=0.5,
        max_tilt_rad=0.1,
    )


def found(*rows: Drive | Stop | Cut | Bound) -> StudyResult:
    return StudyResult(
        drives=tuple(r for r in rows if isinstance(r, Drive)),
        stops=tuple(r for r in rows if isinstance(r, Stop)),
        cuts=tuple(r for r in rows if isinstance(r, Cut)),
        bounds=tuple(r for r in rows if isinstance(r, Bound)),
    )
