# SPDX-License-Identifier: MIT
"""What the silence of a base station leads to, cycle by cycle."""

import pytest

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.safety.modes import StationWatch, Watch, sit_down_values
from segway_ecc.node.safety.settings import StationSettings

PERIOD_NS = 10_000_000
FULL = StationSettings(timeout_s=0.5, sit_down_after_s=1.0, sit_down={"stand": 0.0}, disarm_after_s=2.0)


class Watched:
    """A watch whose cycles are counted for the test."""

    def __init__(self, settings: StationSettings | None = FULL, period_ns: int = PERIOD_NS) -> None:
        self.watch = StationWatch(settings, period_ns)
        self.cycle = 100

    def look(self, *, has_heartbeat: bool = False, is_live: bool = True) -> Watch:
        self.cycle += 1
        return self.watch.look(self.cycle, has_heartbeat=has_heartbeat, is_live=is_live)

    def silence(self, cycles: int, *, is_live: bool = True) -> list[Watch]:
        return [self.look(is_live=is_live) for _ in range(cycles)]


def test_silence_leads_from_step_to_step_after_the_times_of_the_file() -> None:
    watched = Watched()
    assert watched.look(has_heartbeat=True) is Watch.PRESENT
    present, lost, sitting = [Watch.PRESENT] * 50, [Watch.LOST] * 50, [Watch.SIT_DOWN] * 100
    assert watched.silence(300) == [*present, *lost, *sitting, *[Watch.DISARM] * 100]


def test_the_times_are_those_of_the_file_at_another_rate() -> None:
    watched = Watched(period_ns=5_000_000)
    watched.look(has_heartbeat=True)
    found = watched.silence(500)
    assert [found.index(what) for what in (Watch.LOST, Watch.SIT_DOWN, Watch.DISARM)] == [100, 200, 400]


@pytest.mark.parametrize("silent_for", [60, 150, 250])
def test_one_heartbeat_ends_it(silent_for: int) -> None:
    watched = Watched()
    watched.look(has_heartbeat=True)
    assert watched.silence(silent_for)[-1] > Watch.PRESENT
    assert watched.look(has_heartbeat=True) is Watch.PRESENT
    assert watched.silence(50) == [Watch.PRESENT] * 50
    assert watched.look() is Watch.LOST


def test_a_robot_that_nobody_watches_over_runs_alone() -> None:
    watched = Watched()
    assert set(watched.silence(1000)) == {Watch.ALONE}


def test_robot_without_station_settings_runs_alone() -> None:
    watched = Watched(None)
    assert watched.look(has_heartbeat=True) is Watch.ALONE
    assert set(watched.silence(1000)) == {Watch.ALONE}


def test_a_station_that_was_gone_before_the_robot_armed_does_not_watch_over_it() -> None:
    watched = Watched()
    watched.look(has_heartbeat=True, is_live=False)
    assert watched.silence(51, is_live=False)[-2:] == [Watch.PRESENT, Watch.ALONE]
    assert set(watched.silence(1000)) == {Watch.ALONE}
    assert watched.look(has_heartbeat=True) is Watch.PRESENT, "it may still come"


def test_station_silent_since_arming_is_lost() -> None:
    watched = Watched()
    watched.look(has_heartbeat=True, is_live=False)
    watched.silence(40, is_live=False)
    assert watched.silence(11) == [*[Watch.PRESENT] * 10, Watch.LOST]


def test_who_is_disarmed_is_not_watched_over_any_more() -> None:
    watched = Watched()
    watched.look(has_heartbeat=True)
    assert watched.silence(60)[-1] is Watch.LOST
    assert watched.look(is_live=False) is Watch.ALONE
    assert set(watched.silence(1000)) == {Watch.ALONE}


@pytest.mark.parametrize(
    ("settings", "steps"),
    [
        (StationSettings(timeout_s=0.5), [Watch.PRESENT, Watch.LOST]),
        (StationSettings(timeout_s=0.5, disarm_after_s=2.0), [Watch.PRESENT, Watch.LOST, Watch.DISARM]),
        (
            StationSettings(timeout_s=0.5, sit_down_after_s=1.0, sit_down={"stand": 0.0}),
            [Watch.PRESENT, Watch.LOST, Watch.SIT_DOWN],
        ),
    ],
)
def test_a_step_that_the_file_leaves_out_is_never_taken(settings: StationSettings, steps: list[Watch]) -> None:
    watched = Watched(settings)
    watched.look(has_heartbeat=True)
    assert list(dict.fromkeys(watched.silence(10_000))) == steps


def test_a_greater_step_holds_all_of_a_lesser() -> None:
    assert Watch.ALONE < Watch.PRESENT < Watch.LOST < Watch.SIT_DOWN < Watch.DISARM


def test_sitting_down_sets_values_by_their_place() -> None:
    both = StationSettings(sit_down_after_s=2.0, sit_down={"stand": 0.0, "height": 0.25})
    assert sit_down_values(both, ["height", "force", "stand"]) == ((2, 0.0), (0, 0.25))
    assert sit_down_values(StationSettings(), ["stand"]) == ()
    assert sit_down_values(None, []) == ()


def test_a_value_that_is_not_wired_is_refused_in_one_line() -> None:
    with pytest.raises(UnknownNameError) as caught:
        sit_down_values(FULL, ["height", "force"])
    assert str(caught.value) == (
        "no value of station.sit_down that is wired as set.<name> is called 'stand'; there is height, force"
    )
