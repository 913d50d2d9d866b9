# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory, TrajectoryState, TrajectoryStatus
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Player, PlayState, Segment

MS = 1_000_000
EPOCH = 1_700_000_000_000_000_000
MANOEUVRE = Manoeuvre(segments=(Segment(linear=1.0, duration=0.25), Segment(angular=-0.5, duration=0.3)))
ACCEPTED = TrajectoryStatus(
    EPOCH, TrajectoryState.ACCEPTED, "", EPOCH, EPOCH + 550 * MS, 55, Player(MANOEUVRE).trajectory(EPOCH).digest
)


@pytest.fixture
def player() -> Player:
    player = Player(MANOEUVRE)
    player.trajectory(EPOCH)
    return player


def at(ms: int) -> Odometry:
    """The robot, `ms` after the start."""
    return Odometry(EPOCH + ms * MS, float(ms), 0.0, 0.0, 0.0, 0.0)


def test_the_trajectory_holds_the_whole_manoeuvre_and_ends_at_rest() -> None:
    assert Player(MANOEUVRE).trajectory(EPOCH) == Trajectory(
        EPOCH,
        (
            TimedSetpoint(0, Setpoint(1.0, 0.0)),
            TimedSetpoint(250 * MS, Setpoint(0.0, -0.5)),
            TimedSetpoint(550 * MS, REST),
        ),
    )


def test_before_the_robot_answers_nothing_is_known(player: Player) -> None:
    player.receive_odometry(at(100))
    assert (player.start_ns, player.end_ns, player.fraction) == (None, None, 0.0)
    assert (player.state, player.received) == (PlayState.WAITING, [])


def test_it_is_done_when_the_robot_confirms_the_end_and_its_last_odometry_is_there(player: Player) -> None:
    states = []
    player.receive_status(ACCEPTED)
    states.append(player.state)
    player.receive_status(ACCEPTED._replace(state=TrajectoryState.DONE))
    states.append(player.state)
    player.receive_odometry(at(549))
    states.append(player.state)
    player.receive_odometry(at(550))
    states.append(player.state)
    assert states == [PlayState.RUNNING, PlayState.RUNNING, PlayState.RUNNING, PlayState.DONE]


def test_the_last_odometry_alone_is_no_confirmation(player: Player) -> None:
    player.receive_status(ACCEPTED)
    player.receive_odometry(at(560))
    assert player.has_reached_end
    assert player.state is PlayState.RUNNING


def test_odometry_is_kept_from_start_to_end_also_where_it_came_before_the_answer(player: Player) -> None:
    for ms in (-10, 0, 10):
        player.receive_odometry(at(ms))
    player.receive_status(ACCEPTED)
    for ms in (300, 550, 560):
        player.receive_odometry(at(ms))
    assert player.received == [at(0), at(10), at(300), at(550)]


def test_odometry_that_was_lost_on_the_way_is_counted(player: Player) -> None:
    player.receive_status(ACCEPTED)
    assert player.missing == 56
    for ms in range(0, 551, 10):
        if ms not in {0, 200, 210, 550}:
            player.receive_odometry(at(ms))
    assert player.missing == 4


def test_odometry_of_which_each_second_was_lost_is_counted(player: Player) -> None:
    player.receive_status(ACCEPTED)
    for ms in range(-20, 581, 20):
        player.receive_odometry(at(ms))
    assert player.missing == 28


def test_odometry_of_another_robot_is_not_taken_for_this_one_s(player: Player) -> None:
    player.receive_status(ACCEPTED)
    for ms in range(-20, 581, 10):
        player.receive_odometry(at(ms + 3))
        player.receive_odometry(at(ms))
        player.receive_odometry(at(ms))
    assert player.missing == 0
    assert {(each.stamp_ns - EPOCH) % (10 * MS) for each in player.received} == {0}


def test_odometry_that_is_whole_lacks_nothing(player: Player) -> None:
    player.receive_status(ACCEPTED)
    for ms in range(-20, 581, 10):
        player.receive_odometry(at(ms))
    assert player.missing == 0


def test_the_fraction_is_that_of_the_manoeuvre(player: Player) -> None:
    player.receive_status(ACCEPTED)
    fractions = []
    for ms in (-10, 0, 275, 550, 9999):
        player.receive_odometry(at(ms))
        fractions.append(player.fraction)
    assert fractions == [0.0, 0.0, 0.5, 1.0, 1.0]


@pytest.mark.parametrize(
    ("state", "expected"),
    [(TrajectoryState.REFUSED, PlayState.REFUSED), (TrajectoryState.ABORTED, PlayState.BROKEN_OFF)],
)
def test_a_refusal_and_an_abort_are_reported(player: Player, state: TrajectoryState, expected: PlayState) -> None:
    player.receive_status(ACCEPTED._replace(state=state, reason="why"))
    assert player.state is expected
    assert player.status is not None
    assert player.status.reason == "why"


def test_the_answer_to_another_trajectory_is_not_taken_for_ours(player: Player) -> None:
    for state in TrajectoryState:
        player.receive_status(ACCEPTED._replace(stamp_ns=EPOCH - 1, state=state))
    assert player.state is PlayState.WAITING


def test_another_trajectory_that_takes_its_place_breaks_it_off(player: Player) -> None:
    player.receive_status(ACCEPTED)
    states = []
    for state in (TrajectoryState.REFUSED, TrajectoryState.ACCEPTED):
        player.receive_status(ACCEPTED._replace(stamp_ns=EPOCH + 5, state=state))
        states.append(player.state)
    assert states == [PlayState.RUNNING, PlayState.BROKEN_OFF]
    assert player.status is not None
    assert player.status.reason == "another trajectory took its place"
