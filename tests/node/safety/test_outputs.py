# SPDX-License-Identifier: MIT
import math
from collections.abc import Iterable

import pytest

from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.safety.outputs import JUMP_S, Given, OutputWatch
from segway_ecc.node.safety.settings import OscillationLimit, SafetySettings

PERIOD_S = 0.01
GIVEN = {
    "left.torque": Given(0, "N m"),
    "odometry.x": Given(1, "m"),
    "odometry.y": Given(2, "m"),
    "odometry.linear_velocity": Given(3, "m/s"),
    "topic.pitch": Given(4, "rad"),
}
REFUSED = (
    "^no signal of safety.output_limits that an output of the model gives is called 'odometry.heading'; there is left"
)
ALL_NUMBERS = "-1.79769e+308 to 1.79769e+308"
OSCILLATION = OscillationLimit(amplitude=2.0, in_window=4, window_s=0.1)


def watch(**settings: object) -> OutputWatch:
    return OutputWatch(SafetySettings(**settings), GIVEN, ["left.torque"], 8)  # type: ignore[arg-type] # pairs from below


def outputs(torque: float = 0.0, x: float = 0.0, y: float = 0.0, speed: float = 0.0, pitch: float = 0.0) -> list[float]:
    return [torque, x, y, speed, pitch]


def swing(watch: OutputWatch, torques: Iterable[float], period_s: float = PERIOD_S) -> list[bool]:
    return [watch.look(outputs(torque), period_s, is_active=True) is not None for torque in torques]


def test_without_settings_nothing_is_wrong() -> None:
    assert watch().look(outputs(1e308, -1e308, 1e308, 1e308, 1e308), PERIOD_S, is_active=True) is None


@pytest.mark.parametrize("is_active", [True, False])
@pytest.mark.parametrize(
    ("name", "y", "value"),
    [
        ("left.torque", outputs(torque=-3.1), "left.torque -3.1 N m, allowed is -3 to 3 N m"),
        ("odometry.x", outputs(x=1e308), "odometry.x 1e+308 m, allowed is -3 to 3 m"),
        ("topic.pitch", outputs(pitch=3.01), "topic.pitch 3.01 rad, allowed is -3 to 3 rad"),
    ],
)
def test_a_value_beyond_its_limit_is_a_fault_that_names_signal_figure_and_limit(
    name: str, y: list[float], value: str, *, is_active: bool
) -> None:
    limited = watch(output_limits={name: 3.0})
    assert limited.look(y, PERIOD_S, is_active=is_active) == f"the model gives {value}"
    assert limited.fault == f"the model gives {value}"
    for limit in (3.0, -3.0):
        assert limited.look(outputs(*[limit] * 5), PERIOD_S, is_active=is_active) is None, "at its limit it is allowed"
    assert limited.fault is None


@pytest.mark.parametrize(
    ("limits", "allowed"),
    [({}, ALL_NUMBERS), ({"topic.pitch": 3.0}, "-3 to 3"), ({"odometry.x": 3.0}, ALL_NUMBERS)],
)
def test_what_is_computed_of_the_outputs_is_a_fault_where_it_is_beyond_all_numbers(
    limits: dict[str, float], allowed: str
) -> None:
    computed = OutputWatch(SafetySettings(output_limits=limits), GIVEN, ["left.torque"], 4)
    assert computed.look(outputs(1e308, 1.0, 1e308, 1e308, 1.0), PERIOD_S, is_active=True) is None
    fault = computed.look(outputs(pitch=math.inf), PERIOD_S, is_active=True)
    assert fault == f"the model gives topic.pitch inf rad, allowed is {allowed} rad"


def test_a_limit_of_what_the_model_does_not_give_is_refused_with_what_it_gives() -> None:
    with pytest.raises(UnknownNameError, match=REFUSED):
        watch(output_limits={"odometry.heading": 1.0})


def test_a_pose_may_move_as_far_as_the_robot_goes_and_what_was_missing_for_a_moment_adds() -> None:
    moving = watch(output_limits={"odometry.linear_velocity": 2.0})
    farthest = 2.0 * (PERIOD_S + JUMP_S)
    assert moving.look(outputs(x=700.0), PERIOD_S, is_active=True) is None, "it may begin anywhere"
    assert moving.look(outputs(x=700.0 - farthest + 1e-9), PERIOD_S, is_active=True) is None
    assert moving.look(outputs(x=700.0, y=farthest), PERIOD_S, is_active=True) is None
    found = moving.look(outputs(x=700.0, y=-0.01), PERIOD_S, is_active=True)
    assert found == "the model moves odometry.y from 0.42 to -0.01 m in 10 ms, allowed is 0.42 m at 2 m/s"
    assert moving.look(outputs(x=700.0, y=-0.01), PERIOD_S, is_active=True) is None, "from there on it goes on"
    assert moving.look(outputs(x=704.0, y=0.0), 2.0, is_active=True) is None, "in two seconds it gets as far"
    found = moving.look(outputs(x=0.0, y=9.0), PERIOD_S, is_active=True)
    assert str(found).startswith("the model moves odometry.x from 704 to 0 m"), "the first one is named"
    assert moving.look(outputs(x=0.0, y=9.0), PERIOD_S, is_active=True) is None, "both go on from there"


def test_a_model_that_starts_anew_may_jump_and_its_fault_stays_until_it_is_looked_at() -> None:
    moving = watch(output_limits={"odometry.linear_velocity": 2.0, "topic.pitch": 1.0})
    moving.look(outputs(x=700.0, pitch=2.0), PERIOD_S, is_active=True)
    moving.restart()
    assert moving.fault is not None
    assert moving.look(outputs(), PERIOD_S, is_active=True) is None


def test_without_a_limit_of_the_velocity_no_jump_is_seen() -> None:
    assert watch(output_limits={"odometry.x": 1e6}).look(outputs(), PERIOD_S, is_active=True) is None
    assert watch(output_limits={"odometry.x": 1e6}).look(outputs(x=1e6), PERIOD_S, is_active=True) is None


def test_a_command_that_changes_its_sign_in_every_cycle_is_a_fault_as_soon_as_it_is_too_often() -> None:
    limited = watch(oscillation=OSCILLATION)
    assert swing(limited, [2.1, -2.1, 2.1, -2.1]) == [False] * 4, "the first is no change"
    assert limited.look(outputs(2.1), PERIOD_S, is_active=True) == (
        "left.torque oscillates: it changed its sign 4 times within 0.1 s, beyond 2 N m either way, fewer than 4 are "
        "allowed"
    )


@pytest.mark.parametrize(
    ("torques", "is_fault"),
    [
        ([2.0, -5.0] * 20, False),  # no further than the amplitude, on one side or the other
        ([5.0, -2.0] * 20, False),
        ([5.0, 0.0] * 20, False),  # one side only
        ([5.0, 5.0, -5.0, -5.0] * 10, True),  # in every second cycle
        ([5.0, 1.0, 1.0, -1.0, -5.0, -1.0, -1.0, 1.0] * 10, False),  # in every fourth: 3 in 0.1 s
        ([-5.0] * 5 + [5.0] * 5 + [-5.0] * 5 + [5.0] * 5, False),
    ],
)
def test_only_what_changes_its_sign_largely_and_often_oscillates(torques: list[float], *, is_fault: bool) -> None:
    assert any(swing(watch(oscillation=OSCILLATION), torques)) == is_fault


def test_changes_count_for_as_long_as_the_window() -> None:
    # The fourth change comes three periods after the first: within 0.1 s at 33 ms, and just not at 34 ms.
    assert any(swing(watch(oscillation=OSCILLATION), [5.0, -5.0] * 5, 0.033))
    assert not any(swing(watch(oscillation=OSCILLATION), [5.0, -5.0] * 5, 0.034))


def test_changes_at_the_two_ends_of_the_window_are_not_within_it() -> None:
    exact = OscillationLimit(amplitude=0.5, in_window=5, window_s=0.125)
    assert not any(swing(watch(oscillation=exact), [-0.7, 0.7] * 5, 0.03125))
    assert any(swing(watch(oscillation=exact), [-0.7, 0.7] * 5, 0.03))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_neither_the_first_command_nor_the_first_one_that_reaches_the_motors_again_is_a_change(sign: float) -> None:
    limited, torques = watch(oscillation=OSCILLATION), [sign * torque for torque in (5.0, -5.0, 5.0, -5.0)]
    assert swing(limited, torques) == [False] * 4
    assert limited.look(outputs(), PERIOD_S, is_active=False) is None
    assert swing(limited, torques) == [False] * 4


def test_what_does_not_reach_the_motors_oscillates_as_it_likes_and_is_forgotten() -> None:
    limited = watch(oscillation=OSCILLATION)
    torques = [5.0, -5.0] * 10
    assert not any(limited.look(outputs(torque), PERIOD_S, is_active=False) for torque in torques)
    assert swing(limited, torques[:4]) == [False] * 4
    assert limited.look(outputs(5.0), PERIOD_S, is_active=False) is None
    assert swing(limited, torques[:4]) == [False] * 4
