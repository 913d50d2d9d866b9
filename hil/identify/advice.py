# SPDX-License-Identifier: MIT
"""What would tell more about what is still uncertain: each thing that could be done, by the information expected of it.

Manoeuvres are rehearsed: the robot as found, with its new gains, does them on the plant of equations in lock step, and
what its windows would tell is added to what is known (Goodwin, Payne, "Dynamic System Identification: Experiment Design
and Data Analysis", 1977, chapter 6). One in which it falls is not advised. Measuring a quantity by other means counts
as a measurement of it within 1 %. What is expected to leave the least of the uncertain quantities' deviations, as
shares of what they are, comes first (A-optimality, scaled).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec import structs

from segway_ecc.hil.design.balance import Balance
from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.hil.identify.fit import NORMAL_95, Fit, Fitter
from segway_ecc.hil.identify.identify import Identified
from segway_ecc.hil.identify.prediction import Predictor
from segway_ecc.hil.identify.windows import run_of, windows_of
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.segway_parameters import SegwayParameters
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.safety.posture import Posture

_HELPS: Final = 0.9
"""What is left of an interval, from which on something is worth doing."""
_MEASURED: Final = 0.01
_PLANT: Final = "segway_ecc.hil.plants.segway:"
_BEGIN_S: Final = 1.0
_END_S: Final = 5.0
_TURN_S: Final = 3.0

OnRehearsed = Callable[[int, int], None]


class Manoeuvre(NamedTuple):
    """Four seconds of set-points: those of the first half, then those of the second, m/s and rad/s."""

    name: str
    first: tuple[float, float]
    second: tuple[float, float]


MANOEUVRES: Final = (
    Manoeuvre("drive ahead and back at 0.15 m/s", (0.15, 0.0), (-0.15, 0.0)),
    Manoeuvre("drive ahead and back at 0.5 m/s", (0.5, 0.0), (-0.5, 0.0)),
    Manoeuvre("drive ahead and back at 1 m/s", (1.0, 0.0), (-1.0, 0.0)),
    Manoeuvre("spin in place at 1.5 rad/s, both ways", (0.0, 1.5), (0.0, -1.5)),
    Manoeuvre("drive curves at 0.5 m/s and 1.5 rad/s, both ways", (0.5, 1.5), (0.5, -1.5)),
)
MEASUREMENTS: Final = {
    "BodyMass": "weigh the body without its wheels",
    "WheelRadius": "measure how far a turn of a loaded wheel goes",
    "Track": "measure the track",
    "ImuHeight": "measure the IMU's height over the axle",
    "MotorResistance": "measure the motor's resistance",
}


class Advice(NamedTuple):
    """One thing to do.

    Attributes:
        what: In words.
        expected: Half widths that are expected of the intervals that shrink, as shares, by the quantities' names.
    """

    what: str
    expected: Mapping[str, float]


def advise(
    found: Identified,
    file: RobotFile,
    p: SegwayParameters,
    *,
    voltage: bool,
    on_rehearsed: OnRehearsed = lambda _done, _of: None,
) -> tuple[Advice, ...]:
    """What would tell more, the best first; nothing where no size is uncertain by more than a tenth.

    Args:
        found: What is known.
        file: The robot as found, with gains for that.
        p: The same, as the plant's parameters.
        voltage: Whether its drives are given a voltage.
        on_rehearsed: Called with how many manoeuvres were rehearsed, and of how many.
    """
    fit = found.fit
    wide = [place for place, e in enumerate(found.estimates) if e.is_wide]
    if not wide:
        return ()
    gains: list[tuple[str, Matrix]] = []
    for done, manoeuvre in enumerate(MANOEUVRES):
        told = rehearsed(manoeuvre, fit, file, p, voltage=voltage)
        if told is not None:
            gains.append((manoeuvre.name, told / fit.inflation))
        on_rehearsed(done + 1, len(MANOEUVRES))
    for place, e in enumerate(found.estimates):
        if place in wide and e.name in MEASUREMENTS:
            single = np.zeros_like(fit.covariance)
            single[place, place] = _MEASURED**-2.0
            gains.append((f"{MEASUREMENTS[e.name]} (--measured {e.name}=...)", single))
    return ranked(fit.covariance, wide, gains, [e.name for e in found.estimates])


def ranked(
    covariance: Matrix, wide: Sequence[int], gains: Sequence[tuple[str, Matrix]], names: Sequence[str]
) -> tuple[Advice, ...]:
    """Each thing that helps by the information that it gives, the best first.

    Args:
        covariance: As it is.
        wide: Places of what is uncertain.
        gains: What can be done, and the information of it.
        names: Of all quantities.
    """
    before = np.sqrt(np.diag(covariance))
    known = np.linalg.inv(covariance)
    scored = []
    for what, information in gains:
        after: Matrix = np.asarray(np.linalg.inv(known + information), dtype=np.float64)
        deviations = np.sqrt(np.diag(after))
        shrunk = {names[i]: NORMAL_95 * float(deviations[i]) for i in wide if deviations[i] < _HELPS * before[i]}
        if shrunk:
            left = sum(float(deviations[i] / before[i]) for i in wide)
            scored.append((left, Advice(what, shrunk)))
    return tuple(advice for _, advice in sorted(scored, key=lambda pair: pair[0]))


def rehearsed(manoeuvre: Manoeuvre, fit: Fit, file: RobotFile, p: SegwayParameters, *, voltage: bool) -> Matrix | None:
    """The information that a manoeuvre gives of the quantities' coordinates; None where the robot falls in it."""
    if file.simulation is None:
        return None
    plant = _PLANT + ("SegwayPlant" if voltage else "SegwayTorquePlant")
    on_equations = structs.replace(file, simulation=structs.replace(file.simulation, plant=plant))
    balance = Balance(on_equations, pitch=0.0)
    records: list[CycleRecord] = []
    script: dict[float, Callable[[Balance], None]] = {
        _BEGIN_S: lambda b: b.drive(*manoeuvre.first),
        _TURN_S: lambda b: b.drive(*manoeuvre.second),
    }
    balance.run(_END_S, script, until_fallen=True, keep=records.append)
    if balance.postures[-1] is not Posture.BALANCING:
        return None
    try:
        windows = windows_of(
            [run_of(records, layout_of(balance.robot), skip_s=_BEGIN_S)], radius=p.wheel_radius, stop_angle=p.stop_angle
        )
    except ConfigurationError:  # it never moved
        return None
    return Fitter(Predictor(p, fit.quantities, voltage=voltage), fit.quantities, windows).information(
        fit.coordinates, fit.deviations
    )
