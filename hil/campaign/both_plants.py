# SPDX-License-Identifier: MIT
"""The same runs where wheels roll without slipping and where they slip, side by side."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from segway_ecc.hil.campaign.scenario import ScenarioResult, ScenarioRun
from segway_ecc.hil.floor.contact import has_contact
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.config import load_robot

_HEAD: Final = ("scenario", "robot", "seed", "without slip", "on the floor", "reason on the floor")


class Difference(NamedTuple):
    """A run that ends otherwise on the floor: how it ends without slip, and there."""

    rolling: ScenarioResult
    floor: ScenarioResult

    @property
    def why(self) -> str:
        """What the robot gave as its reason on the floor, or that it lies there."""
        fallen = "lies on the ground" if self.floor.has_fallen and not self.rolling.has_fallen else ""
        return self.floor.reason or fallen or "drives on there"

    def as_json(self) -> Mapping[str, Any]:
        """How both end, and the commands that run them again."""
        return {
            "scenario": self.floor.scenario,
            "robot": self.floor.robot,
            "seed": self.floor.seed,
            "parameters": dict(self.floor.parameters),
            "without_slip": {**_ending(self.rolling), "command": self.rolling.command},
            "on_the_floor": {**_ending(self.floor), "command": self.floor.command},
        }


def sampled(runs: Sequence[ScenarioRun], count: int | None) -> list[ScenarioRun]:
    """So many of them, at even distances; all where that is None, or more than there are."""
    if count is None or count >= len(runs):
        return list(runs)
    return [runs[place * len(runs) // count] for place in range(count)]


def with_contact(runs: Sequence[ScenarioRun]) -> list[ScenarioRun]:
    """Those of robots for which there is a plant whose wheels slip."""
    has = {robot: has_contact(load_robot(robot)) for robot in {run.robot for run in runs}}
    return [run for run in runs if has[run.robot]]


def on_both(runs: Sequence[ScenarioRun], friction: float) -> list[ScenarioRun]:
    """Each run without slip, and behind it the same on a floor of this friction."""
    return [either for run in runs for either in (run, run._replace(floor=friction))]


def differences(results: Sequence[ScenarioResult]) -> Iterator[Difference]:
    """Of the results of `on_both`, those that end otherwise: in outcome, posture, or lying on the ground."""
    for rolling, floor in zip(results[::2], results[1::2], strict=True):
        if _ending(rolling) != _ending(floor):
            yield Difference(rolling, floor)


def table_of(found: Sequence[Difference], pairs: int, friction: float) -> str:
    """The differences, and how many there are of how many pairs of runs."""
    verdict = f"{len(found)} of {pairs} runs end otherwise on a floor with a friction of {friction:g}"
    rows = [
        (d.floor.scenario, d.floor.robot, str(d.floor.seed), _words(d.rolling), _words(d.floor), d.why) for d in found
    ]
    return "".join(f"{line}\n" for line in (*(aligned([_HEAD, *rows]) if rows else ()), verdict))


def _ending(result: ScenarioResult) -> dict[str, Any]:
    return {"outcome": result.outcome, "posture": result.posture, "has_fallen": result.has_fallen}


def _words(result: ScenarioResult) -> str:
    lies = ", lies" if result.has_fallen and result.posture != "FALLEN" else ""
    return f"{result.outcome} {result.posture}{lies}".replace("  ", " ").strip()
