# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.hil.case_study.seats import Repeats
from segway_ecc.hil.errors import RigError, RunFailedError, SpoiledRunError
from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.node.errors import ConfigurationError, SequenceError


class Fails:
    """Fails so many times, and remembers the suffixes it was given."""

    def __init__(self, times: int, error: Exception) -> None:
        self.suffixes: list[str] = []
        self._times, self._error = times, error

    def __call__(self, suffix: str) -> str:
        self.suffixes.append(suffix)
        if len(self.suffixes) <= self._times:
            raise self._error
        return "result"


def ended(code: int | None) -> ProcessFailedError:
    error = ProcessFailedError("lost")
    error.ended_with = code
    return error


@pytest.mark.parametrize("error", [RigError("lost"), SpoiledRunError("lost"), *map(ended, (None, -9, 5, 6, 7, 9, 13))])
def test_a_run_is_repeated_until_it_succeeds_under_a_name_of_its_own(error: Exception) -> None:
    repeats, once = Repeats(), Fails(2, error)

    assert repeats.run("ros turn", 3, once) == "result"
    assert once.suffixes == ["", "_try_2", "_try_3"]
    assert repeats.causes == ["ros turn, try 1 of 3: lost", "ros turn, try 2 of 3: lost"]


def test_a_run_that_succeeds_at_once_is_not_reported() -> None:
    repeats = Repeats()

    assert repeats.run("ros turn", 3, Fails(0, RigError("lost"))) == "result"
    assert repeats.causes == []


def test_after_the_last_try_every_failure_is_in_the_error() -> None:
    once = Fails(9, RigError("lost"))
    with pytest.raises(
        RunFailedError, match="ros turn failed in each of 3 tries, the last time: lost; end other"
    ) as error:
        Repeats().run("ros turn", 3, once)

    assert [str(failure) for failure in error.value.failures] == ["lost"] * 3
    assert len(once.suffixes) == 3


@pytest.mark.parametrize(("tries", "is_over"), [(1, False), (3, True)])
def test_a_run_that_may_not_be_repeated_fails_with_its_own_error(tries: int, is_over: object) -> None:
    repeats, once = Repeats(), Fails(9, RigError("lost"))
    with pytest.raises(RigError, match=r"^lost$"):
        repeats.run("offline turn", tries, once, lambda: bool(is_over))

    assert len(once.suffixes) == 1
    assert repeats.causes == []


@pytest.mark.parametrize(
    "error",
    [
        HardwareError("no bus"),
        ConfigurationError("no file"),
        SequenceError("refused"),
        *map(ended, (1, 2, 102, -11)),
    ],
)
def test_an_error_that_no_loss_and_no_stall_causes_is_not_repeated(error: Exception) -> None:
    once = Fails(9, error)
    with pytest.raises(type(error)):
        Repeats().run("ros turn", 3, once)

    assert len(once.suffixes) == 1
