# SPDX-License-Identifier: MIT
"""What one check found."""

import enum
from collections.abc import Iterable
from dataclasses import dataclass


class Verdict(enum.StrEnum):
    """Whether what was found fits a robot."""

    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was looked at and found.

    Attributes:
        name: What was looked at.
        verdict: Whether it fits.
        found: What is there.
        effect: What that does to the robot; empty only where it is good.
        remedy: The command or the file that changes it; empty only where it is good.
    """

    name: str
    verdict: Verdict
    found: str
    effect: str = ""
    remedy: str = ""

    def __post_init__(self) -> None:
        """Refuse a defect without its effect or its remedy; ValueError."""
        if self.verdict is not Verdict.GOOD and not (self.effect and self.remedy):
            raise ValueError(f"finding '{self.name}' is {self.verdict} and lacks its effect or remedy")


def good(name: str, found: str) -> Finding:
    """What is as it should be, or stands only for information."""
    return Finding(name, Verdict.GOOD, found)


def warning(name: str, found: str, effect: str, remedy: str) -> Finding:
    """What the robot runs with, but less well."""
    return Finding(name, Verdict.WARNING, found, effect, remedy)


def bad(name: str, found: str, effect: str, remedy: str) -> Finding:
    """What the robot must not run with."""
    return Finding(name, Verdict.BAD, found, effect, remedy)


def graded(name: str, found: str, effect: str, remedy: str, *, fits: bool) -> Finding:
    """Good where it fits, else a warning."""
    return warning(name, found, effect, remedy) if not fits else good(name, found)


def is_fit(findings: Iterable[Finding]) -> bool:
    """Whether nothing is bad."""
    return all(finding.verdict is not Verdict.BAD for finding in findings)
