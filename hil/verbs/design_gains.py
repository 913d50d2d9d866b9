# SPDX-License-Identifier: MIT
"""`segway-ecc design gains`: the gains of a balancing robot from what it is made of, with poles and margins."""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from segway_ecc.hil.design.linear_model import Margins
from segway_ecc.hil.design.robot_text import rounded, with_parameters
from segway_ecc.hil.design.segway import MOST_DELAY, Design, Loop, design
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.config import RobotFile, load_robot, packaged_robots, read_text
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.load import load_model
from segway_ecc.node.models.segway_parameters import VARIABLES, SegwayParameters
from segway_ecc.node.readable import short

DELAY: Final = 2
"""Periods: one until the command leaves in the next cycle's exchange, one at most until the drive's loop takes it."""
_APART: Final = 1e-6
"""Of the largest pole: what is nearer to another, or to an axis, is on it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `design`."""
    parser.add_argument("robot", help=f"a robot file, or one of {', '.join(packaged_robots())}")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the robot file with these gains")
    parser.add_argument(
        "--delay",
        type=int,
        default=DELAY,
        choices=range(MOST_DELAY + 1),
        help="periods from a measurement until its torque acts (default: %(default)s)",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Design, print, and write the robot file where that is asked for."""
    text = read_text(options.robot)
    file = load_robot(options.robot)
    found = designed(file, options.delay)
    if options.out is not None:
        changed = with_parameters(text, "model", {**file.model.parameters, **rounded(found.gains)})
        try:
            options.out.write_text(changed, encoding="utf-8")
        except OSError as error:
            raise ConfigurationError(f"cannot write robot file '{options.out}': {error.strerror}") from error
        sys.stderr.write(f"segway-ecc: wrote {options.out}\n")
    loops = {"balance": _loop_as_json(found.balance), "yaw": _loop_as_json(found.yaw)}
    print_found(options, {"gains": rounded(found.gains), **loops}, _as_text(found))
    return 0


def designed(file: RobotFile, delay: int = DELAY) -> Design:
    """The design for a robot file: for the plant that it names, at the step of its model.

    Raises:
        ConfigurationError: The plant is no segway, or the model has not these gains.
    """
    model = load_model(file.model.source, file.model.parameters)
    found = design(segway_parameters(file), model.step_size, delay)
    lacking = sorted(set(found.gains) - {variable.name for variable in model.parameters})
    if lacking:
        raise ConfigurationError(f"model '{model.name}' has no parameter {', '.join(lacking)}: it is no segway's")
    return found


def segway_parameters(file: RobotFile) -> SegwayParameters:
    """What the plant of a robot file is made of.

    Raises:
        ConfigurationError: It is no segway.
    """
    plant = simulated_plant(file)
    names = {variable.name for variable in plant.parameters}
    lacking = [variable.name for variable in VARIABLES if variable.name not in names]
    if lacking:
        raise ConfigurationError(f"plant '{plant.name}' is no segway: it has no {', '.join(lacking)}")
    return SegwayParameters.from_model({variable.name: plant.read(variable.name) for variable in VARIABLES})


def _loop_as_json(loop: Loop) -> dict[str, Any]:
    m = loop.margins
    return {
        "open_poles_rad_s": [[pole.real, pole.imag] for pole in loop.open_poles],
        "closed_poles_z": [[pole.real, pole.imag] for pole in loop.closed_poles],
        "gain_margin_up": m.gain_up if math.isfinite(m.gain_up) else None,
        "gain_margin_down": m.gain_down,
        "phase_margin_deg": math.degrees(m.phase_rad),
        "delay_margin_s": m.delay_s,
        "crossover_rad_s": m.crossover_rad_s,
    }


def _as_text(found: Design) -> dict[str, str]:
    rows = {name: short(value) for name, value in found.gains.items()}
    for name, loop in (("balance", found.balance), ("yaw", found.yaw)):
        m = loop.margins
        rows[f"{name}: open-loop poles, rad/s"] = pole_text(loop.open_poles)
        rows[f"{name}: closed-loop poles, z"] = pole_text(loop.closed_poles)
        rows[f"{name}: gain margin"] = _gain_margin(m)
        rows[f"{name}: phase margin"] = f"{math.degrees(m.phase_rad):.1f} degrees at {short(m.crossover_rad_s)} rad/s"
        rows[f"{name}: delay margin"] = f"{m.delay_s * 1e3:.1f} ms more than the design's"
    return rows


def _gain_margin(m: Margins) -> str:
    """Between which factors the gain may lie; where nothing limits it, what is found is rounding, and no factor."""
    down = f"times {short(m.gain_down)}" if m.gain_down > _APART else ""
    up = f"times {short(m.gain_up)}" if m.gain_up < 1.0 / _APART else ""
    if down and up:
        return f"{down} to {short(m.gain_up)}"
    return f"{down} and more" if down else f"up to {up}" if up else "any"


def pole_text(poles: Sequence[complex]) -> str:
    """Poles in a row, two that are conjugate as one entry.

    Two that lie in one place come apart by the root of the rounding, 1e-8 of the largest: that is no part of them.
    """
    least = _APART * max(map(abs, poles), default=0.0)
    texts = []
    for pole in poles:
        real, imaginary = short(pole.real, least), short(abs(pole.imag), least)
        if imaginary == "0":
            texts.append(real)
        elif pole.imag > 0.0:
            texts.append(f"{real} +- {imaginary}j")
    return ", ".join(texts)
