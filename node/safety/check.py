# SPDX-License-Identifier: MIT
"""What every check of the sensors is."""

from abc import ABC, abstractmethod
from collections.abc import Sequence


class View:
    """What a check sees in one cycle.

    Attributes:
        values: Newest value of each signal, SI, in the order of the robot's signals.
        valid: Whether each is fresh enough to be used.
        periods: How many periods have passed since the last cycle started: 1, and more where one started late.
        setpoint: The set-point in force, m/s and rad/s; None where the robot follows none.
        elapsed_s: The same to the nanosecond, s; None where it is not known.
        balances: Whether the robot does, and neither stands up nor lies.
        sent: The commands that left in it; empty where nobody says.
        spins: Whether a wheel has lost the floor; the check that sees it says so to those after it.
    """

    def __init__(  # noqa: PLR0913 - what there is of a cycle
        self,
        values: Sequence[float],
        valid: Sequence[bool],
        periods: int,
        setpoint: tuple[float, float] | None = None,
        elapsed_s: float | None = None,
        *,
        balances: bool = False,
        sent: Sequence[float] = (),
    ) -> None:
        """Show one cycle to every check."""
        self.values = values
        self.valid = valid
        self.periods = periods
        self.setpoint = setpoint
        self.elapsed_s = elapsed_s
        self.balances = balances
        self.sent = sent
        self.spins = False
        self._is_complete = False not in valid

    @property
    def is_idle(self) -> bool:
        """Whether no motor is sent anything."""
        return bool(self.sent) and not any(self.sent)

    def has(self, indices: Sequence[int]) -> bool:
        """Whether all of these signals may be used."""
        if self._is_complete:  # in nearly every cycle, so that each check need not look
            return True
        valid = self.valid
        for index in indices:  # noqa: SIM110 - a generator in all() takes three times as long
            if not valid[index]:
                return False
        return True


class Check(ABC):
    """Looks at every cycle; without the values of the signals that it needs it cannot see."""

    needs: tuple[int, ...]

    @abstractmethod
    def look(self, view: View) -> str | None:
        """What is wrong, if anything; values that are not valid are not looked at."""


def periods_in(duration_s: float, period_s: float) -> int:
    """How many periods a duration is, at least one."""
    return max(round(duration_s / period_s), 1)
