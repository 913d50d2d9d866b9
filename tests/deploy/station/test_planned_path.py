# SPDX-License-Identifier: MIT
"""The way that a sequence leads is that of its set-points."""

import math

import pytest

from segway_ecc.deploy.station.planned_path import MOST_POINTS, planned_path
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Segment

START = Odometry(0, 1.0, 2.0, math.pi / 2, 0.0, 0.0)


def test_straight_way_leads_ahead_of_the_robot() -> None:
    path = planned_path(Manoeuvre(segments=(Segment(linear=0.5, duration=4.0),)), START)
    assert len(path) == MOST_POINTS
    assert (path[0], path[-1]) == ((1.0, 2.0), (1.0, 4.0))
    assert path[21] == pytest.approx((1.0, 2.67), abs=0.01)


def test_full_circle_ends_where_it_began_and_turns_left() -> None:
    turn = Segment(linear=0.5, angular=math.pi / 4, duration=8.0)
    path = planned_path(Manoeuvre(segments=(turn,)), START)
    radius = 0.5 / (math.pi / 4)
    assert path[-1] == pytest.approx(path[0], abs=0.01)
    assert min(x for x, _ in path) == pytest.approx(1.0 - 2 * radius, abs=0.02)


def test_turn_on_the_spot_moves_nothing_and_the_next_segment_goes_that_way() -> None:
    segments = (Segment(angular=-math.pi / 2, duration=1.0), Segment(linear=1.0, duration=1.0))
    path = planned_path(Manoeuvre(segments=segments), START)
    assert path[20] == (1.0, 2.0)
    assert path[-1] == (2.0, 2.0)


def test_many_short_segments_have_no_more_points() -> None:
    segments = tuple(Segment(linear=0.1 * (number % 7), duration=0.05) for number in range(500))
    path = planned_path(Manoeuvre(segments=segments), START)
    assert len(path) == MOST_POINTS
    way = sum(segment.linear * segment.duration for segment in segments)
    assert path[-1][1] == pytest.approx(2.0 + way, abs=0.01)
