# SPDX-License-Identifier: MIT
"""Results as text."""

from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.hil.campaign.result import ScenarioResult
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
