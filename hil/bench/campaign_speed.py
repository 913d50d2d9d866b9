"""How many declared scenarios a second a campaign runs."""

import os
import time
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.campaign.campaign import run_campaign, runs_of
from segway_ecc.hil.campaign.scenario import load_all

CAMPAIGN_WANTED: Final = 10.0
"""Runs a second on two cores: what a campaign is to be."""
_SAMPLE: Final = 32
_BEGIN: Final = 4
"""Runs for each core that are not counted: its process has to start first."""


@dataclass(frozen=True, slots=True)
class CampaignSpeed:
    """A part of the campaign, evenly chosen.

    Attributes:
        runs: Runs that were counted.
        of: Runs of the whole campaign.
        jobs: Processes at a time.
        took_s: How long those counted took.
    """

    runs: int
    of: int
    jobs: int
    took_s: float

    @property
    def runs_per_s(self) -> float:
        """Runs a second."""
        return self.runs / self.took_s


def campaign_speed(sample: int = _SAMPLE) -> CampaignSpeed:
    """Run every n-th trial of the campaign on all cores."""
    trials = runs_of(list(load_all([])))
    jobs = len(os.sched_getaffinity(0))
    chosen = trials[:: max(len(trials) // (sample + jobs * _BEGIN), 1)]
    first = jobs * _BEGIN
    times: list[float] = []
    run_campaign(chosen, jobs, lambda _done, _all: times.append(time.monotonic()))
    return CampaignSpeed(len(times) - first, len(trials), jobs, times[-1] - times[first - 1])
