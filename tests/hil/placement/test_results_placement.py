# SPDX-License-Identifier: MIT
"""Which flows cross the network, for every placement."""

import pytest

from segway_ecc.hil.placement.results import ON_THE_ROBOT, PLACEMENTS, Placement, Site

R, S = Site.ROBOT, Site.STATION


def test_there_are_eight_and_the_first_has_everything_on_the_robot() -> None:
    assert len(set(PLACEMENTS)) == 8
    assert ON_THE_ROBOT == (R, R, R, "")


@pytest.mark.parametrize(
    ("places", "crossing", "words"),
    [
        ((R, R, R), (False, False, False), "all on the robot"),
        ((S, R, R), (True, False, False), "sequence on the station"),
        ((R, S, R), (True, True, True), "balance on the station"),
        ((R, R, S), (False, False, True), "supervision on the station"),
        ((S, S, R), (False, True, True), "sequence and balance on the station"),
        ((S, R, S), (True, False, True), "sequence and supervision on the station"),
        ((R, S, S), (True, True, False), "balance and supervision on the station"),
        ((S, S, S), (False, True, False), "sequence and balance and supervision on the station"),
    ],
)
def test_what_crosses_is_what_speaks_to_another_place(
    places: tuple[Site, Site, Site], crossing: tuple[bool, bool, bool], words: str
) -> None:
    placement = Placement(*places)
    assert (placement.sequence_crosses, placement.balance_crosses, placement.supervision_crosses) == crossing
    assert placement.at_station == places.count(S)
    assert str(placement) == words
