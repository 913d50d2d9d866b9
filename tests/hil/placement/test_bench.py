# SPDX-License-Identifier: MIT
"""Runs over a network in lock step: the same bits without one, and the physics of one with."""

import msgspec
import pytest

from segway_ecc.hil.placement.bench import START_S, PlacementRun, run
from segway_ecc.hil.placement.network import Delivery, Network, Partition
from segway_ecc.hil.placement.results import ON_THE_ROBOT, PLACEMENTS, Placement
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment, single_segment

MANOEUVRE = Manoeuvre(segments=(Segment(linear=0.5, duration=0.6),))
AWAY = Placement._make(PLACEMENTS[2])
COMMANDED = PLACEMENTS[5]


def job(placement: Placement, network: Network | None = None, **more: object) -> PlacementRun:
    plain = PlacementRun(robot="segway", placement=placement, manoeuvre=MANOEUVRE, until_s=START_S + 1.0)
    return msgspec.structs.replace(plain, network=network or Network(), **more)


@pytest.fixture(scope="module")
def on_board() -> str:
    return run(job(ON_THE_ROBOT)).digest


@pytest.mark.parametrize("placement", [PLACEMENTS[i] for i in (2, 5, 7)], ids=str)
def test_without_a_network_it_does_not_matter_where_what_is(placement: Placement, on_board: str) -> None:
    assert run(job(placement, stamped=placement.at_station != 1)).digest == on_board


def test_equal_seeds_give_equal_bits_and_others_do_not() -> None:
    network = Network(latency_s=0.004, jitter_s=0.003, loss=0.01)
    digests = [run(job(AWAY, network, seed=seed, until_s=2.0)).digest for seed in (1, 1, 2)]
    assert digests[0] == digests[1] != digests[2]


def test_the_seed_is_that_of_the_sensors_too() -> None:
    assert run(job(ON_THE_ROBOT, until_s=1.5, seed=1)).digest != run(job(ON_THE_ROBOT, until_s=1.5, seed=2)).digest


def test_the_seed_is_that_of_the_network_too() -> None:
    """When a stop arrives is a matter of the network alone."""
    pressed_s, network = 1.5, Network(latency_s=0.1, jitter_s=0.09)
    zero = {run(job(COMMANDED, network, until_s=2.0, stop_at_s=pressed_s, seed=seed)).zero_s for seed in (1, 2, 3)}
    assert len(zero) > 1


def test_the_order_of_messages_makes_a_difference() -> None:
    network = Network(latency_s=0.006, jitter_s=0.006)
    digests = {run(job(AWAY, network, delivery=delivery, until_s=2.0)).digest for delivery in Delivery}
    assert len(digests) > 1


def test_stamped_set_points_hide_the_network_and_others_come_late(on_board: str) -> None:
    network = Network(latency_s=0.1, jitter_s=0.05)
    assert run(job(COMMANDED, network, stamped=True)).digest == on_board
    late, still = (
        next(at.time for at in run(each).since(START_S) if at.linear_velocity > 0.1)
        for each in (job(COMMANDED, network, stamped=False), job(ON_THE_ROBOT))
    )
    assert 0.05 < late - still < 0.16


def test_a_stop_crosses_the_network_once() -> None:
    pressed_s = START_S + 0.5
    seen = run(job(COMMANDED, Network(latency_s=0.05), stop_at_s=pressed_s))
    assert seen.zero_s is not None
    # The way, the wait for the next cycle, and for the drive's next tick.
    assert 0.05 <= seen.zero_s - pressed_s <= 0.065
    assert seen.changes[-1].mode is Mode.FAULT


def test_a_lost_stop_is_asked_for_again() -> None:
    pressed_s = START_S + 0.3
    network = Network(latency_s=0.01, partitions=(Partition(pressed_s - 0.01, 0.15),))
    seen = run(job(COMMANDED, network, stop_at_s=pressed_s))
    assert seen.zero_s is not None
    assert 0.14 < seen.zero_s - pressed_s < 0.25


def test_a_station_without_heartbeats_is_lost_after_its_second() -> None:
    watched, cut_s = PLACEMENTS[1], START_S + 0.05
    seen = run(job(watched, Network(partitions=(Partition(cut_s, 9.0),)), until_s=START_S + 1.3))
    assert (seen.changes[-1].mode, seen.changes[-1].reason) == (Mode.HOLD, "the base station is lost")
    # The last heartbeat came up to a tenth of a second before.
    assert 0.9 < seen.changes[-1].at_ns * 1e-9 - cut_s < 1.02


def test_without_commands_the_guard_on_the_robot_stops_the_drives_and_the_robot_falls() -> None:
    cut_s = START_S + 0.2
    network = Network(partitions=(Partition(cut_s, 2.0),))
    seen = run(job(AWAY, network))
    assert seen.guard_s is not None
    # 30 ms after the last command, which came at most a cycle before, and within a pass of the guard.
    assert 0.025 < seen.guard_s - cut_s < 0.035
    assert seen.zero_s is not None
    assert seen.zero_s - cut_s < 0.045
    assert seen.fell_s(START_S) is not None


def test_a_robot_on_its_own_drives_is_not_disturbed_by_the_guard() -> None:
    seen = run(job(ON_THE_ROBOT))
    assert seen.guard_s is None
    assert [change.mode for change in seen.changes] == [Mode.ARMED]
    assert seen.max_tilt(START_S) < 0.2


def test_a_push_pushes() -> None:
    pushed, left = (
        run(job(ON_THE_ROBOT, manoeuvre=single_segment(0.0, 0.0, 0.1), until_s=START_S + 1.4, pushed_n=force))
        for force in (10.0, 0.0)
    )
    assert pushed.max_tilt(START_S) > left.max_tilt(START_S) + 0.02
    assert pushed.is_calm_at_the_end is False
    assert left.is_calm_at_the_end is True


def test_a_run_that_is_to_end_with_the_fall_does() -> None:
    network = Network(partitions=(Partition(START_S + 0.2, 2.0),))
    seen = run(job(AWAY, network, until_s=START_S + 5.0, until_fallen=True))
    fell_s = seen.fell_s(START_S)
    assert fell_s is not None
    assert seen.end_s - fell_s < 0.02
