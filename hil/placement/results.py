# SPDX-License-Identifier: MIT
"""What the placement study finds."""

import msgspec

from segway_ecc.hil.placement.judging import RunOutcome


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Which cell of the grid.

    Attributes:
        sequence: Where sequence control is: robot or station.
        balance: Where balance control is.
        supervision: Where supervision is.
        network: The name of the network.
        setpoints: On which topic set-points travel; empty where they do not cross the network.
    """

    sequence: str
    balance: str
    supervision: str
    network: str
    setpoints: str = ""

    @property
    def placement(self) -> tuple[str, str, str]:
        """Where the three are."""
        return self.sequence, self.balance, self.supervision


class Drive(Row, frozen=True, kw_only=True):
    """A manoeuvre, against the same with everything on the robot.

    Attributes:
        outcome: What came of it.
        reason: The first reason that was given for anything but driving on.
        max_position_m: Largest distance, m.
        rms_position_m: Its root mean square, m.
        max_velocity_m_s: Largest difference of the velocity ahead, m/s.
        rms_velocity_m_s: Its root mean square, m/s.
        max_tilt_rad: Largest tilt, rad.
        digest: Over everything that the drives gave and all truth: equal digests are equal bits.
    """

    outcome: RunOutcome
    reason: str
    max_position_m: float
    rms_position_m: float
    max_velocity_m_s: float
    rms_velocity_m_s: float
    max_tilt_rad: float
    digest: str


class Stop(Row, frozen=True, kw_only=True):
    """A stop that was pressed while it drove.

    Attributes:
        zero_s: From each press to the last torque, s; None where the robot lay before, or the torque went on.
        outcome: What had come of the robot before the press, the worst of all.
    """

    zero_s: tuple[float | None, ...]
    outcome: RunOutcome

    @property
    def worst_s(self) -> float | None:
        """The longest; None where one press did nothing."""
        times = [time_s for time_s in self.zero_s if time_s is not None]
        return max(times) if len(times) == len(self.zero_s) else None


class Cut(Row, frozen=True, kw_only=True):
    """A partition while it drove.

    Attributes:
        partition_s: How long nothing passed, s.
        outcome: What came of it.
        did: What the robot did by itself, with how long after the beginning of the partition.
        max_position_m: Largest distance from the robot without a network, m.
        max_tilt_rad: Largest tilt, rad.
    """

    partition_s: float
    outcome: RunOutcome
    did: str
    max_position_m: float
    max_tilt_rad: float


class Bound(msgspec.Struct, frozen=True, kw_only=True):
    """A limit of balance control on the station, by search.

    Attributes:
        robot: Which robot.
        what: Of what.
        unit: Of it.
        tolerated: The largest that was tolerated with every seed.
        lost: The smallest that was not; None where the largest tried was tolerated.
        lost_by: What the robot gave as reason then.
        theory: What theory gives for it; None where it gives nothing.
    """

    robot: str
    what: str
    unit: str
    tolerated: float
    lost: float | None
    lost_by: str
    theory: float | None = None


class StudyResult(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that the study found."""

    drives: tuple[Drive, ...]
    stops: tuple[Stop, ...]
    cuts: tuple[Cut, ...]
    bounds: tuple[Bound, ...]
