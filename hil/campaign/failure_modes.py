# SPDX-License-Identifier: MIT
"""The results of a campaign as the failure modes of a robot's parts and their effects (FMEA), in Markdown."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby

from segway_ecc.hil.campaign.scenario import Scenario, ScenarioResult
from segway_ecc.hil.faults.fault import KINDS, Fault

_INTRODUCTION = """# Failure modes of the parts

`segway-ecc prove campaign --out FOLDER` writes this file: each row is a scenario, with the worst of its runs, in
lock step. Times count from the failure, in ms: until the mode or the line changed (detected), and until the last torque
or voltage that a drive gave (torque zero). The distance, in m, is from where the robot without the failure is then.
A failure without a text is that of the row above, with another amount. Behind the outcome stands the posture at the
end.
"""
_HEAD = (
    "Failure",
    "Amount",
    "Scenario",
    "Robots",
    "Runs",
    "Outcome",
    "Detected",
    "Torque zero",
    "Distance",
    "Tilt, rad",
)


def failure_modes(scenarios: Iterable[Scenario], results: Sequence[ScenarioResult]) -> str:
    """A table for each part, with a row for each scenario: the worst of its runs."""
    by_name: dict[str, list[ScenarioResult]] = {}
    for result in results:
        by_name.setdefault(result.scenario, []).append(result)
    rows = sorted((scenario for scenario in scenarios if scenario.faults), key=_order)
    lines = [_INTRODUCTION, *_summary(results)]
    for part, found in groupby(rows, key=_part):
        lines += ["", f"## {part[:1].upper()}{part[1:]}", "", _line(_HEAD), _line(["---"] * len(_HEAD))]
        above = ""
        for scenario in found:
            failure = _failures(scenario)
            lines.append(_line(("" if failure == above else failure, *_row(scenario, by_name[scenario.name]))))
            above = failure
    return "\n".join((*lines, ""))


def _summary(results: Sequence[ScenarioResult]) -> list[str]:
    """How many runs there are of each robot, and how each ended."""
    outcomes = sorted({result.outcome for result in results})
    head = ("Robot", "Runs", *outcomes)
    lines = [_line(head), _line(["---"] * len(head))]
    robots = Counter(result.robot for result in results)
    ends = Counter((result.robot, result.outcome) for result in results)
    for robot, count in sorted(robots.items()):
        lines.append(_line((robot, str(count), *(str(ends[robot, outcome]) for outcome in outcomes))))
    every = Counter(result.outcome for result in results)
    return [*lines, _line(("all", str(len(results)), *(str(every[outcome]) for outcome in outcomes)))]


def _order(scenario: Scenario) -> tuple[str, str, str, float]:
    name, _, amount = scenario.name.partition("@")
    return _part(scenario), _failures(scenario), name, float(amount or "-inf")


def _part(scenario: Scenario) -> str:
    return " and ".join(_unique(fault.target.replace("_", " ") for fault in scenario.faults))


def _failures(scenario: Scenario) -> str:
    return "; ".join(_unique(KINDS[fault.target][fault.type].does for fault in scenario.faults))


def _row(scenario: Scenario, results: Sequence[ScenarioResult]) -> tuple[str, ...]:
    outcomes = ", ".join(sorted({_end(result) for result in results}))
    is_off = all(result.outcome in {"faults", "stopped", "disarmed"} for result in results)
    return (
        "; ".join(_unique(filter(None, map(_amount, scenario.faults)))),
        f"`{scenario.name}`",
        ", ".join(scenario.robots),
        str(len(results)),
        outcomes + ("" if all(result.is_as_expected for result in results) else ", NOT AS EXPECTED"),
        _worst([result.detection_s for result in results], 1e3, 1),
        _worst([math.inf if result.safe_s is None else result.safe_s for result in results], 1e3, 1) if is_off else "",
        _worst([result.max_distance_m for result in results], 1.0, 3),
        _worst([result.max_tilt_rad for result in results], 1.0, 3),
    )


def _end(result: ScenarioResult) -> str:
    return f"{result.outcome} {result.posture}".strip()


def _amount(fault: Fault) -> str:
    kind = KINDS[fault.target][fault.type]
    texts = [
        fault.name or "",
        f"{fault.size:g} {kind.unit}" if kind.unit and fault.size is not None else "",
        "" if fault.for_s is None else f"for {fault.for_s:g} s",
        "" if fault.every_s is None else f"every {fault.every_s:g} s",
        "" if fault.since == "armed" else "from power-on",
    ]
    return ", ".join(filter(None, texts))


def _worst(values: Sequence[float | None], factor: float, digits: int) -> str:
    worst = max((value for value in values if value is not None), default=None)
    if worst is None:
        return ""
    return f"{worst * factor:.{digits}f}" if math.isfinite(worst) else "never"


def _unique(texts: Iterable[str]) -> Iterable[str]:
    return dict.fromkeys(texts)


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
