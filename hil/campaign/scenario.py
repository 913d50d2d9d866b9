# SPDX-License-Identifier: MIT
"""A scenario: a robot, what it is to do, what fails, and what must come of it."""

import importlib.resources
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

import msgspec

from segway_ecc.firmware_io.value import Section
from segway_ecc.hil.faults.fault import Fault, Seconds
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

Outcome = Literal["drives_on", "holds", "faults"]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]

MODEL: Final = "model."
PLANT: Final = "plant."
_OFF: Final = re.compile(r"(\btype:\s*)off\b")
"""In YAML 1.1 a bare `off` is the value false; here it is a type of fault."""
_PACKAGED: Final = importlib.resources.files("segway_ecc.hil") / "scenarios"


class Expectation(Section, frozen=True, kw_only=True):
    """What must come of it. What is left out is not looked at.

    Attributes:
        outcome: The most severe thing that happens after the fault: the robot drives on as if nothing were; it holds
            its place for a while or for good; or the motors are off.
        reason: A part of the reason that the robot gives for its mode, or for passing to its other line.
        within_s: Longest time from the fault to the change of mode or line, s.
        safe_within_s: Longest time from the fault to the last torque or voltage that a drive gave, s.
        max_tilt_rad: Largest tilt of the body from upright, either way, rad.
        max_distance_m: Largest distance from where the robot without the fault is at the same time, m.
    """

    outcome: Outcome
    reason: str | None = None
    within_s: Positive | None = None
    safe_within_s: Positive | None = None
    max_tilt_rad: Positive | None = None
    max_distance_m: Positive | None = None


class Scenario(Section, frozen=True, kw_only=True):
    """One declared scenario.

    Attributes:
        robot: The robot file, or the name of one that ships with the package; or several, of which the same is
            expected.
        segments: What the robot is to do from when it is armed on.
        faults: What fails.
        expect: What must come of it.
        about: Why that must come of it.
        seeds: Seeds of chance. Seed 0 makes each fault exactly when declared, every other up to 20 ms later.
        parameters: Sets of parameters other than their own: `plant.NAME` or `model.NAME`, in their units.
        fallback: Whether the robot has a serial line to fall back on.
    """

    name: Annotated[str, msgspec.Meta(pattern="^[a-z0-9_-]+$")]
    robot: str | Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    segments: Annotated[tuple[Segment, ...], msgspec.Meta(min_length=1)]
    expect: Expectation
    faults: tuple[Fault, ...] = ()
    about: str = ""
    seeds: Annotated[tuple[Annotated[int, msgspec.Meta(ge=0)], ...], msgspec.Meta(min_length=1)] = (0,)
    parameters: Annotated[tuple[dict[str, float], ...], msgspec.Meta(min_length=1)] = ({},)
    fallback: bool = False

    def __post_init__(self) -> None:
        """Refuse parameters of nothing, a fault after the end, and a serial fault without a line."""
        for name in [name for each in self.parameters for name in each]:
            check_parameter(name)
        late = [fault.at_s for fault in self.faults if fault.at_s >= self.duration_s]
        if late:
            raise ValueError(f"a fault at {late[0]:g} s comes after the segments' {self.duration_s:g} s")
        if not self.fallback and any(fault.target == "serial" for fault in self.faults):
            raise ValueError("a fault of the serial line needs fallback: true")

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots."""
        return (self.robot,) if isinstance(self.robot, str) else self.robot

    @property
    def manoeuvre(self) -> Manoeuvre:
        """The segments."""
        return Manoeuvre(segments=self.segments)

    @property
    def duration_s(self) -> Seconds:
        """Length of the segments together, s."""
        return sum(segment.duration for segment in self.segments)


class ScenarioRun(NamedTuple):
    """One run to be made.

    Attributes:
        source: The scenario's file, or its name.
        parameters: Parameters other than their own.
    """

    source: str
    scenario: Scenario
    robot: str
    seed: int
    parameters: Mapping[str, float]


def check_parameter(name: str) -> None:
    """Refuse a parameter that is neither the model's nor the plant's.

    Raises:
        ValueError: It is neither.
    """
    if not name.startswith((MODEL, PLANT)):
        raise ValueError(f"the parameter '{name}' must begin with {MODEL} or {PLANT}")


def packaged_scenarios() -> list[str]:
    """The names of the scenarios that ship with the package."""
    return sorted(entry.name.removesuffix(".yaml") for entry in _PACKAGED.iterdir() if entry.name.endswith(".yaml"))


def load_scenario(source: str) -> Scenario:
    """Read a scenario: a YAML file, or the name of one that ships with the package.

    Raises:
        ConfigurationError: The file is missing or not as it must be; the text gives the path within the file.
    """
    packaged = packaged_scenarios()
    try:
        file = _PACKAGED / f"{source}.yaml" if source in packaged else Path(source)
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(
            f"cannot read scenario '{source}': {reason}; the packaged ones are {', '.join(packaged)}"
        ) from error
    return decode_yaml(_OFF.sub(r"\1'off'", text), Scenario, source)


def load_all(sources: list[str]) -> Iterator[tuple[str, Scenario]]:
    """Read scenarios, each with its source; without any, those that ship with the package."""
    for source in sources or packaged_scenarios():
        yield source, load_scenario(source)
