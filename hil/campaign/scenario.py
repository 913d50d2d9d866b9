# SPDX-License-Identifier: MIT
"""A scenario: a robot, what it is to do, what fails, what must come of it; and what came of it, as text too."""

import importlib.resources
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from segway_ecc.firmware_io.value import Section
from segway_ecc.hil.faults.fault import Fault, Seconds
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.documents import decode_yaml, read_document
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

HEAD: Final = (
    "scenario",
    "robot",
    "seed",
    "outcome",
    "detected, ms",
    "safe, ms",
    "tilt, rad",
    "distance, m",
    "verdict",
)
Outcome = Literal["drives_on", "holds", "faults", "disarmed", "stopped", "never armed"]
_DRIVEN: Final = frozenset({"drives_on", "holds"})
"""Outcomes that no robot may have that lies on the ground."""
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
            its place for a while or for good; the motors are off, by a fault, by request, or since the loop ended with
            an error; or it is never armed.
        reason: A part of the reason that the robot gives for its mode, or for passing to its other line; where there
            are several, one of them.
        within_s: Longest time from the fault to the change of mode or line, s.
        safe_within_s: Longest time from the fault to the last torque or voltage that a drive gave, s.
        posture: What the robot is doing at the end, where it has a posture.
        max_tilt_rad: Largest tilt of the body from upright, either way, rad.
        max_distance_m: Largest distance from where the robot without the fault is at the same time, m.
    """

    outcome: Outcome
    reason: str | Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] | None = None
    within_s: Positive | None = None
    safe_within_s: Positive | None = None
    posture: Posture | None = None
    max_tilt_rad: Positive | None = None
    max_distance_m: Positive | None = None


class Case(Section, frozen=True, kw_only=True):
    """A scenario with another amount of its first fault, or for longer, or at another time: one of the three.

    Something else may be expected of it; what is not given is as without it.
    """

    expect: Expectation | None = None
    amount: float | None = None
    for_s: Positive | None = None
    at_s: Seconds | None = None

    def __post_init__(self) -> None:
        """Refuse a case of nothing, and one of several."""
        if len(self.change) != 1:
            raise ValueError("a case has one of amount, for_s and at_s")

    @property
    def change(self) -> dict[str, float]:
        """What is different."""
        given = {"amount": self.amount, "for_s": self.for_s, "at_s": self.at_s}
        return {name: value for name, value in given.items() if value is not None}

    @property
    def suffix(self) -> str:
        """What tells it from the others."""
        (value,) = self.change.values()
        return f"@{value:g}"


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
        cases: The same with its first fault otherwise; each is a scenario too, called NAME@AMOUNT.
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
    cases: tuple[Case, ...] = ()

    def __post_init__(self) -> None:
        """Refuse parameters of nothing, a fault after the end or of no line, and cases that are none."""
        for name in [name for each in self.parameters for name in each]:
            check_parameter(name)
        late = [fault.at_s for fault in self.faults if fault.at_s >= self.duration_s]
        if late:
            raise ValueError(f"a fault at {late[0]:g} s comes after the segments' {self.duration_s:g} s")
        if not self.fallback and any(fault.target == "serial" for fault in self.faults):
            raise ValueError("a fault of the serial line needs fallback: true")
        if not self.cases:
            return
        if not self.faults or len(set(self.case_names)) < 1 + len(self.cases):
            raise ValueError("cases are different amounts of the first fault of a scenario")
        self.with_cases()

    @property
    def case_names(self) -> list[str]:
        """Its own name, and that of each case."""
        return [self.name, *(self.name + case.suffix for case in self.cases)]

    def with_cases(self) -> list["Scenario"]:
        """This scenario, and one for each of its cases.

        Raises:
            ValueError: An amount is not one of its fault's.
        """
        changed = [
            {
                "faults": (replace(self.faults[0], **case.change), *self.faults[1:]),
                "expect": case.expect or self.expect,
            }
            for case in self.cases
        ]
        return [
            replace(self, name=name, cases=(), **change)
            for name, change in zip(self.case_names, [{}, *changed], strict=True)
        ]

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
    """One run to be made, of a scenario from a file or by its name, with parameters other than their own.

    `floor` is the friction of the floor, where wheels are to slip; None for the plant that the robot file names.
    """

    source: str
    scenario: Scenario
    robot: str
    seed: int
    parameters: Mapping[str, float]
    floor: float | None = None


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
    """Read a scenario: a YAML file, or the name of one that ships with the package; with @AMOUNT behind it, its case.

    Raises:
        ConfigurationError: The file is missing or not as it must be; the text gives the path within the file.
    """
    base = source if Path(source).exists() else source.rpartition("@")[0] or source
    scenario = _read(base)
    if base == source:
        return scenario
    name = scenario.name + source.removeprefix(base)
    for found in scenario.with_cases():
        if found.name == name:
            return found
    raise ConfigurationError(f"no scenario '{source}'; {base} has {', '.join(scenario.case_names)}")


def load_all(sources: list[str]) -> Iterator[tuple[str, Scenario]]:
    """Read scenarios and their cases, each with its source; without any, those that ship with the package."""
    for source in sources or packaged_scenarios():
        scenario = load_scenario(source)
        for found in scenario.with_cases():
            yield source + found.name.removeprefix(scenario.name), found


def _read(source: str) -> Scenario:
    packaged = packaged_scenarios()
    try:
        file = _PACKAGED / f"{source}.yaml" if source in packaged else Path(source)
        text = read_document(file)
    except OSError as error:
        raise ConfigurationError(
            f"cannot read scenario '{source}': {error.strerror}; the packaged ones are {', '.join(packaged)}"
        ) from error
    return decode_yaml(_OFF.sub(r"\1'off'", text), Scenario, source)


class ScenarioResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one run.

    Attributes:
        source: The file, or the name, of the scenario.
        parameters: The parameters other than their own.
        outcome: drives_on, holds, faults; or never armed, unsafe (the motors are on though the node has given up or is
            dead), stopped (an error ended the loop).
        reason: The reasons that the robot gave after the fault.
        detection_s: From the fault to the change of mode or line; None where there was none.
        safe_s: From the fault to the last torque or voltage at a drive; None where it went on.
        max_tilt_rad: Largest tilt either way; None where the plant has none.
        has_fallen: Whether the plant has lain on the ground since it stood.
        max_distance_m: Largest distance from the robot without the fault.
        switches: The reasons for passing to another line.
        digest: Of everything that the drives gave, and all truth.
        posture: What the robot was doing at the end, by the node; empty where it has no posture.
        floor: The friction of the floor; None where wheels never slip.
        why_not: How it differs from what was expected; empty where it does not.
    """

    source: str
    scenario: str
    robot: str
    seed: int
    parameters: Mapping[str, float]
    outcome: str
    reason: str
    detection_s: float | None
    safe_s: float | None
    max_tilt_rad: float | None
    max_distance_m: float
    switches: tuple[str, ...]
    simulated_s: float
    digest: str
    posture: str = ""
    has_fallen: bool = False
    floor: float | None = None
    why_not: tuple[str, ...] = ()

    @property
    def is_as_expected(self) -> bool:
        """Whether it came as expected."""
        return not self.why_not

    @property
    def command(self) -> str:
        """The command that runs it again."""
        sets = [word for name, value in self.parameters.items() for word in ("--set", f"{name}={value!r}")]
        words = ["segway-ecc", "prove", "fault", self.source, "--robot", self.robot, "--seed", str(self.seed)]
        floor = [] if self.floor is None else ["--floor", f"{self.floor:g}"]
        return shlex.join([*words, *sets, *floor])


def judged(result: ScenarioResult, expect: Expectation) -> ScenarioResult:
    """A result with what differs from what was expected."""
    why_not = []
    if result.outcome != expect.outcome:
        why_not.append(f"outcome {result.outcome}, not {expect.outcome}")
    if result.has_fallen and result.outcome in _DRIVEN:
        why_not.append(f"the robot lies on the ground, and {result.outcome}")
    reasons = (expect.reason,) if isinstance(expect.reason, str) else expect.reason or ()
    if reasons and not any(reason in result.reason for reason in reasons):
        why_not.append(f"reason '{result.reason}' has no " + " or ".join(f"'{reason}'" for reason in reasons))
    if expect.posture is not None and result.posture != expect.posture:
        why_not.append(f"posture {result.posture or 'none'}, not {expect.posture}")
    limits = {
        "detected": (result.detection_s, expect.within_s, "s"),
        "safe": (result.safe_s, expect.safe_within_s, "s"),
        "tilt": (result.max_tilt_rad, expect.max_tilt_rad, "rad"),
        "distance": (result.max_distance_m, expect.max_distance_m, "m"),
    }
    for name, (value, limit, unit) in limits.items():
        if limit is not None and value is None:
            why_not.append(f"never {name}" if unit == "s" else f"the plant has no {name}")
        elif limit is not None and value is not None and not value <= limit:
            why_not.append(f"{name} {value:.4g} {unit}, more than {limit:g} {unit}")
    return replace(result, why_not=tuple(why_not))


def cells(result: ScenarioResult) -> tuple[str, ...]:
    """One row, in the order of `HEAD`."""
    tilt = "" if result.max_tilt_rad is None else f"{result.max_tilt_rad:.3f}"
    return (
        result.scenario,
        result.robot if result.floor is None else f"{result.robot}, friction {result.floor:g}",
        str(result.seed),
        result.outcome,
        _ms(result.detection_s),
        _ms(result.safe_s),
        tilt,
        f"{result.max_distance_m:.3f}",
        "as expected" if result.is_as_expected else "NOT AS EXPECTED",
    )


def table(results: Sequence[ScenarioResult]) -> str:
    """All results, and under each that is not as expected why, and how to see it again."""
    head, *rows = aligned([HEAD, *map(cells, results)])
    lines = [head]
    for result, row in zip(results, rows, strict=True):
        lines.append(row)
        if not result.is_as_expected:
            lines += [f"    {text}" for text in (*result.why_not, result.command)]
    return "".join(f"{line}\n" for line in (*lines, verdict(results)))


def verdict(results: Sequence[ScenarioResult]) -> str:
    """How many are as expected, in one line."""
    good = sum(result.is_as_expected for result in results)
    return f"{good} of {len(results)} runs as expected"


def details(result: ScenarioResult) -> Mapping[str, str]:
    """One result, name by name."""
    named = dict(zip(HEAD, cells(result), strict=True))
    extra = {
        "floor": "" if result.floor is None else f"friction {result.floor:g}",
        "parameters": ", ".join(f"{name}={value:g}" for name, value in result.parameters.items()) or "its own",
        "reason": result.reason or "none",
        "posture": result.posture,
        "lines": "; ".join(result.switches) or "not changed",
        "simulated": f"{result.simulated_s:.2f} s",
        "digest": result.digest,
    }
    why = {"why not": "; ".join(result.why_not)} if result.why_not else {}
    return {name: text for name, text in {**named, **extra, **why, "again": result.command}.items() if text}


def _ms(duration_s: float | None) -> str:
    return "never" if duration_s is None else f"{duration_s * 1e3:.1f}"
