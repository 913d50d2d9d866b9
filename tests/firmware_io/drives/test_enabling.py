# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.drives.enabling import Enabling, Phase

MS = 1_000_000


@pytest.fixture
def enabling() -> Enabling:
    return Enabling()


def _phase(enabling: Enabling) -> Phase:
    return enabling.phase


def test_starts_off_and_is_never_overdue_there(enabling: Enabling) -> None:
    assert _phase(enabling) is Phase.OFF
    assert not enabling.is_overdue(10**18)


def test_is_enabled_once_asked_and_confirmed(enabling: Enabling) -> None:
    enabling.begin(0)
    assert _phase(enabling) is Phase.ENABLING
    enabling.confirm()
    assert _phase(enabling) is Phase.ENABLED


def test_a_confirmation_that_was_not_asked_for_means_nothing(enabling: Enabling) -> None:
    enabling.confirm()
    assert _phase(enabling) is Phase.OFF


def test_a_second_confirmation_changes_nothing(enabling: Enabling) -> None:
    enabling.begin(0)
    enabling.confirm()
    enabling.confirm()
    assert _phase(enabling) is Phase.ENABLED


def test_retracts_a_confirmation_of_a_command_that_is_young(enabling: Enabling) -> None:
    enabling.begin(1_000)
    enabling.confirm()
    enabling.retract(1_101, 100)
    assert _phase(enabling) is Phase.ENABLED
    enabling.retract(1_100, 100)
    assert _phase(enabling) is Phase.ENABLING


def test_what_was_not_confirmed_is_not_retracted(enabling: Enabling) -> None:
    enabling.retract(0, 100)
    assert _phase(enabling) is Phase.OFF


def test_ends_from_any_phase(enabling: Enabling) -> None:
    enabling.end(5)
    assert _phase(enabling) is Phase.OFF
    enabling.begin(0)
    enabling.end(5)
    assert _phase(enabling) is Phase.OFF
    enabling.confirm()
    assert _phase(enabling) is Phase.OFF, "a confirmation of what was asked before"
    enabling.begin(0)
    enabling.confirm()
    enabling.end(5)
    assert _phase(enabling) is Phase.OFF


def test_is_overdue_after_half_a_second_until_it_is_confirmed(enabling: Enabling) -> None:
    enabling.begin(7_000 * MS)
    assert not enabling.is_overdue(7_500 * MS)
    assert enabling.is_overdue(7_500 * MS + 1)
    enabling.confirm()
    assert not enabling.is_overdue(10**18)


def test_the_time_begins_anew_each_time_it_is_asked(enabling: Enabling) -> None:
    enabling.begin(0)
    enabling.end(5)
    assert not enabling.is_overdue(10_000 * MS)
    enabling.begin(9_800 * MS)
    assert not enabling.is_overdue(10_000 * MS)
    enabling.begin(20_000 * MS)
    assert not enabling.is_overdue(20_400 * MS)


def test_asking_again_when_enabled_waits_for_a_new_confirmation(enabling: Enabling) -> None:
    enabling.begin(0)
    enabling.confirm()
    enabling.begin(1)
    assert _phase(enabling) is Phase.ENABLING


def test_disable_feedback_needs_a_report() -> None:
    assert not Enabling().confirms_disable(None)
    assert Enabling().confirms_disable(0), "no command to disable was sent"


@pytest.mark.parametrize(("received_ns", "counts"), [(9, False), (10, False), (11, True)])
def test_disable_feedback_received_by_the_time_of_the_command_does_not_count(
    enabling: Enabling, received_ns: int, *, counts: bool
) -> None:
    enabling.begin(1)
    enabling.end(10)
    assert enabling.confirms_disable(received_ns) is counts


def test_disable_feedback_survives_a_second_command_to_disable(enabling: Enabling) -> None:
    enabling.begin(1)
    enabling.end(10)
    enabling.end(20)
    assert enabling.confirms_disable(11)
