# SPDX-License-Identifier: MIT
"""What came of a run, whether it is what was expected, and results as text."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from segway_ecc.hil.campaign.scenario import Expectation
from segway_ecc.hil.text_table import aligned

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
        max_distance_m: Largest distance from the robot without the fault.
        switches: The reasons for passing to another line.
        digest: Of everything that the drives gave, and all truth.
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
        return shlex.join([*words, *sets])


def judged(result: ScenarioResult, expect: Expectation) -> ScenarioResult:
    """A result with what differs from what was expected."""
    why_not = []
    if result.outcome != expect.outcome:
        why_not.append(f"outcome {result.outcome}, not {expect.outcome}")
    if expect.reason is not None and expect.reason not in result.reason:
        why_not.append(f"reason '{result.reason}' has no '{expect.reason}'")
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
    return msgspec.structs.replace(result, why_not=tuple(why_not))


def cells(result: ScenarioResult) -> tuple[str, ...]:
    """One row, in the order of `HEAD`."""
    tilt = "" if result.max_tilt_rad is None else f"{result.max_tilt_rad:.3f}"
    return (
        result.scenario,
        result.robot,
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
        "parameters": ", ".join(f"{name}={value:g}" for name, value in result.parameters.items()) or "its own",
        "reason": result.reason or "none",
        "lines": "; ".join(result.switches) or "not changed",
        "simulated": f"{result.simulated_s:.2f} s",
        "digest": result.digest,
    }
    why = {"why not": "; ".join(result.why_not)} if result.why_not else {}
    return {name: text for name, text in {**named, **extra, **why, "again": result.command}.items() if text}


def _ms(duration_s: float | None) -> str:
    return "never" if duration_s is None else f"{duration_s * 1e3:.1f}"
