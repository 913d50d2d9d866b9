# SPDX-License-Identifier: MIT
"""The report of a robot's commissioning: its form, where it lies, and whether the robot may arm by it.

`segway-ecc design commission` writes it. It holds for the drives, IMU, wiring and model parameters that the robot file
had then, each by its digest. It is read once, before the loop runs.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from segway_ecc.firmware_io.value import Section
from segway_ecc.node.config import NoHardwareSection, RobotFile, packaged_robots
from segway_ecc.node.documents import decode_yaml, read_document
from segway_ecc.node.errors import ConfigurationError

Verdict = Literal["passed", "confirmed", "refused", "left out"]
"""Of a step: measured and good, stated by the person and not measured, refused, or not done."""

STEPS: Final = (
    "signals",
    "encoders",
    "motors",
    "strength",
    "imu",
    "pitch zero",
    "wheel radius",
    "track",
    "limits",
    "watchdog",
    "e-stop",
    "guard",
    "kill",
    "held",
    "alone",
)
"""The steps, in their order."""
_LINES: Final = frozenset({"can", "serial"})
"""The keys of `hardware`, and of its IMU, that say over which lines they are reached."""
MAY_BE_LEFT_OUT: Final = frozenset({"guard"})
"""Of a robot whose file does not require one."""


class StepReport(Section, frozen=True, kw_only=True):
    """The outcome of a step: the reason as one line, and what was measured, by name with the unit in the name."""

    step: str
    verdict: Verdict
    text: Annotated[str, msgspec.Meta(max_length=2000)]
    measured: dict[str, float] = msgspec.field(default_factory=dict)


class CommissioningReport(Section, frozen=True, kw_only=True):
    """A whole commissioning.

    Attributes:
        robot: The name in the robot file.
        date: When it ended, ISO 8601.
        version: Of this software.
        is_simulated: Whether the robot was a simulated one: such a report lets no robot arm.
        digests: Of each part of the robot file that it holds for; see `digests_of`.
        steps: What became of each step, in their order.
    """

    robot: str
    date: str
    version: str
    is_simulated: bool
    digests: dict[str, str]
    steps: tuple[StepReport, ...]

    @property
    def lacking(self) -> list[str]:
        """The steps that did not pass, or are missing."""
        good = {each.step for each in self.steps if each.verdict in {"passed", "confirmed"}}
        good |= {each.step for each in self.steps if each.verdict == "left out" and each.step in MAY_BE_LEFT_OUT}
        return [step for step in STEPS if step not in good]


def digests_of(file: RobotFile) -> dict[str, str]:
    """SHA-256, hexadecimal, of each part of a robot file that a commissioning holds for.

    Over which bus and serial lines the robot is reached does not count, nor the folder that its model lies in.
    """
    hardware = msgspec.to_builtins(file.hardware)
    if not isinstance(file.hardware, NoHardwareSection):
        imu = hardware["external_imu"]
        hardware = _without_lines(hardware) | {"external_imu": None if imu is None else _without_lines(imu)}
    model = {"source": file.model.source.rpartition("/")[2], "parameters": file.model.parameters}
    safety = msgspec.to_builtins(file.safety)
    wiring: dict[str, object] = dict(file.wiring)
    if file.mixing:
        wiring |= {"mixing": msgspec.to_builtins(file.mixing), "geometry": msgspec.to_builtins(file.geometry)}
    parts = {"hardware": hardware, "wiring": wiring, "model": model, "safety": safety}
    return {
        name: hashlib.sha256(msgspec.json.encode(part, order="deterministic")).hexdigest()
        for name, part in parts.items()
    }


def _without_lines(section: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in section.items() if name not in _LINES}


def report_path(robot: str) -> Path:
    """Where the report of a robot lies: beside its file, or in the current folder for a packaged robot."""
    if robot in packaged_robots():
        return Path(f"{robot}.commissioned.yaml")
    path = Path(robot)
    return path.with_name(f"{path.stem}.commissioned.yaml")


def read_report(path: Path) -> CommissioningReport:
    """Read a report.

    Raises:
        ConfigurationError: It is missing, or not as it must be.
    """
    try:
        text = read_document(path)
    except OSError as error:
        raise ConfigurationError(f"there is no commissioning report {path}: {error.strerror}") from error
    return decode_yaml(text, CommissioningReport, f"commissioning report {path}")


def why_not_commissioned(file: RobotFile, path: Path | None) -> str | None:
    """Why the robot counts as not commissioned, in one line.

    None where it is commissioned, or where its file does not require it.
    """
    if file.commissioned != "required":
        return None
    if path is None:
        return "no commissioning report was named"
    try:
        report = read_report(path)
    except ConfigurationError as error:
        return str(error)
    reason = _why_not_good(file, report)
    return None if reason is None else f"{path} of {report.date} {reason}"


def _why_not_good(file: RobotFile, report: CommissioningReport) -> str | None:
    """What keeps a report from being one that the robot may arm by."""
    if report.robot != file.name:
        return f"is the report of robot '{report.robot}', not '{file.name}'"
    if report.is_simulated:
        return "is of a simulated robot"
    now = digests_of(file)
    changed = [name for name in now if report.digests.get(name) != now[name]]
    if changed:
        return f"is stale: {', '.join(changed)} changed in the robot file since"
    if report.lacking:
        return f"has not passed: {', '.join(report.lacking)}"
    return None
