# SPDX-License-Identifier: MIT
"""`segway-ecc design identify`: what a balancing robot is made of, from logs of its runs, and the gains for that."""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from segway_ecc.hil.design.robot_text import rounded, with_parameters
from segway_ecc.hil.identify.advice import Advice, advise
from segway_ecc.hil.identify.identify import Identified, identify
from segway_ecc.hil.identify.robot_text import with_ranges, with_safety
from segway_ecc.hil.identify.windows import read_run
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.hil.text_table import aligned
from segway_ecc.hil.verbs.design_gains import designed, segway_parameters
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.config import RobotFile, decode_robot, read_text
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.load import load_model
from segway_ecc.node.models.segway_parameters import SegwayParameters
from segway_ecc.node.readable import short
from segway_ecc.node.recording.layout import ROBOT_TEXT
from segway_ecc.node.recording.salvage import Salvage

_ROUNDED: Final = 0.9999


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `design identify`."""
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG", help="logs of runs of one robot")
    parser.add_argument("--robot", metavar="FILE", help="the robot file to start from (default: the first log's)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the robot file with what was found, and gains")
    parser.add_argument(
        "--skip",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="leave out the first seconds of each log, when a hand held it",
    )
    parser.add_argument(
        "--measured",
        action="append",
        default=[],
        type=_measured,
        metavar="NAME=VALUE",
        help="what you measured, SI; held within 1 %%; may be given again",
    )
    parser.add_argument("--no-advice", action="store_true", help="do not work out what would tell more")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Identify, print, and write the robot file where that is asked for."""
    read = [read_run(path, options.skip) for path in options.logs]
    text = _text(options, need=options.out is not None)
    file = read[0][1] if text is None else decode_robot(text, "the robot file")
    names = sorted({recorded.name for _, recorded in read})
    if len(names) > 1:
        raise ConfigurationError(f"the logs are of different robots ({', '.join(names)}): identify one at a time")
    with show_progress("passes") as progress:
        found = identify(
            [recorded for recorded, _ in read],
            segway_parameters(file),
            voltage=is_by_voltage(file),
            measured=dict(options.measured),
            on_pass=progress,
        )
    advice: tuple[Advice, ...] = ()
    changed, notes = ("", []) if text is None else rewritten(text, file, found)
    if text is not None and not options.no_advice:
        as_found = decode_robot(changed, "the robot file with what was identified")
        with show_progress("manoeuvres") as progress:
            advice = advise(
                found,
                as_found,
                segway_parameters(as_found),
                voltage=is_by_voltage(file),
                on_rehearsed=progress,
            )
    if options.json:
        print_json(options, as_json(found, advice))
    else:
        sys.stdout.write("\n".join(as_text(found, advice)) + "\n")
    if options.out is not None:
        try:
            options.out.write_text(changed, encoding="utf-8")
        except OSError as error:
            raise ConfigurationError(f"cannot write robot file '{options.out}': {error.strerror}") from error
        sys.stderr.write("".join(f"segway-ecc: {note}\n" for note in (*notes, f"wrote {options.out}")))
    return 0


def is_by_voltage(file: RobotFile) -> bool:
    """Whether the robot's drives are given a voltage."""
    return simulated_plant(file).inputs[0].name.endswith("voltage")


def rewritten(text: str, file: RobotFile, found: Identified) -> tuple[str, list[str]]:
    """The robot file's text with what was found, what follows from it, and new gains; and what to look at in it.

    Raises:
        ConfigurationError: The file is not laid out as the packaged ones are.
    """
    before, model = segway_parameters(file), load_model(file.model.source, file.model.parameters)
    parts = rounded({e.name: e.value for e in found.estimates if e.is_parameter})
    plant = {} if file.simulation is None else file.simulation.parameters
    roll = rounded({"BodyRollInertia": _roll_inertia(before, parts)})
    changed = with_parameters(text, "simulation", {**plant, **parts, **roll})
    own = {variable.name for variable in model.parameters}
    follows = {name: value for name, value in parts.items() if name in own}
    if "TorqueLimit" in own:
        follows |= rounded({"TorqueLimit": model.read("TorqueLimit") * min(1.0, _grip(parts, before))})
    changed, moved = with_ranges(changed, file, follows)
    changed = with_safety(changed, segway_parameters(decode_robot(changed, "the robot file with its plant")))
    changed = with_parameters(changed, "model", {**file.model.parameters, **follows})
    gains = designed(decode_robot(changed, "the robot file with what was identified")).gains
    changed = with_parameters(changed, "model", {**file.model.parameters, **follows, **rounded(gains)})
    return changed, [f"moved model.ranges: {text}; see that it is what you want" for text in moved]


def _grip(parts: Mapping[str, float], p: SegwayParameters) -> float:
    """How much more torque a tyre carries than before: in proportion to the robot's mass and to the wheels' radius."""
    wheels = 2.0 * p.wheel_mass
    mass, radius = parts.get("BodyMass", p.body_mass), parts.get("WheelRadius", p.wheel_radius)
    return (mass + wheels) * radius / ((p.body_mass + wheels) * p.wheel_radius)


def _roll_inertia(p: SegwayParameters, parts: Mapping[str, float]) -> float:
    """The body's about its length, as found, if a body can be so.

    No moment of inertia of a body is larger than the sum of the two others.
    """
    pitch, yaw = parts.get("BodyPitchInertia", p.body_pitch_inertia), parts.get("BodyYawInertia", p.body_yaw_inertia)
    roll = parts.get("BodyRollInertia", p.body_roll_inertia)
    return max(min(roll, _ROUNDED * (pitch + yaw)), abs(pitch - yaw) / _ROUNDED)


def as_text(found: Identified, advice: Sequence[Advice] = ()) -> list[str]:
    """A table of what was found, and what to know of it."""
    rows = [("quantity", "unit", "before", "found", "+- (95 %)", "")]
    rows += [(e.name, e.unit, short(e.known), short(e.value), e.interval_text, e.remark) for e in found.estimates]
    lines = [*aligned(rows), *(f"note: {remark}" for remark in found.remarks)]
    if advice:
        lines += ["", "What would tell more, the best first, with the intervals that are expected of it:"]
        lines += [f"- {one.what}: {_expected(one)}" for one in advice]
        left = [e.name for e in found.estimates if e.is_wide and not any(e.name in one.expected for one in advice)]
        lines += [f"- nothing that was tried: {', '.join(left)}"] if left else []
    return lines


def as_json(found: Identified, advice: Sequence[Advice] = ()) -> dict[str, Any]:
    """The same as data."""
    return {
        "quantities": {
            e.name: {
                "unit": e.unit,
                "before": e.known,
                "found": e.value,
                "least": e.least,
                "most": e.most,
                "origin": e.origin.value,
                "together_with": list(e.together_with),
            }
            for e in found.estimates
        },
        "windows": found.fit.windows,
        "outliers": found.fit.outliers,
        "remarks": list(found.remarks),
        "advice": [{"what": one.what, "expected_half_widths": dict(one.expected)} for one in advice],
    }


def _expected(advice: Advice) -> str:
    return ", ".join(f"{name} +-{100.0 * half:.1f} %" for name, half in advice.expected.items())


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is no time in seconds, such as 2.5")
    return value


def _measured(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    try:
        return (name, float(value)) if equals else _refuse(text)
    except ValueError:
        return _refuse(text)


def _refuse(text: str) -> tuple[str, float]:
    raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE with a number, such as BodyMass=5.2")


def _text(options: argparse.Namespace, *, need: bool) -> str | None:
    """The robot file as it was written."""
    if options.robot is not None:
        return read_text(options.robot)
    text = Salvage(options.logs[0]).attachments.get(ROBOT_TEXT)
    if text is None and need:
        raise ConfigurationError(f"{options.logs[0]} holds no text of the robot file: name the file with --robot")
    return text.decode() if isinstance(text, bytes) else text
