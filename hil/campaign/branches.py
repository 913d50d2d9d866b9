# SPDX-License-Identifier: MIT
"""Runs that differ in their faults alone, made once up to where the first fault of each begins.

Until then they are one and the same run, the trunk. Shortly before, the process that makes it forks: its child declares
the faults, goes on to the end and hands its result back, while the trunk waits. What a child finds is what a whole run
finds, to the last bit.
"""

import contextlib
import os
import pickle
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, Generic, NamedTuple, TypeVar

from segway_ecc.hil.errors import RigError
from segway_ecc.hil.faults.fault import Fault, Injections
from segway_ecc.node.parent import end_with

Result = TypeVar("Result")
BEFORE_NS: Final = 50_000_000
"""How long before its first fault a run branches off: some cycles and steps of the plant, so that whatever keeps the
value before a fault has seen it."""
_FAILED: Final = 70


class AllBranchedError(RigError):
    """The trunk ends: all that it was made for has branched off."""


class Branch(NamedTuple):
    """What distinguishes a run from the trunk."""

    faults: Sequence[Fault]
    seed: int

    @property
    def begins_ns(self) -> int | None:
        """When it branches off, ns after the robot was armed; None where it cannot."""
        if not self.faults or any(fault.acts_ahead for fault in self.faults):
            return None
        begins_ns = (Injections(self.faults, self.seed, lambda: 0).first_ns or 0) - BEFORE_NS
        return begins_ns if begins_ns > 0 else None


class Branches(Generic[Result]):
    """Has runs branch off a trunk; see `Source`."""

    def __init__(self, injections: Injections, branches: Sequence[Branch]) -> None:
        """Prepare to branch off a run with these injections, which are none yet; ValueError where one cannot."""
        begin = [branch.begins_ns for branch in branches]
        places = {place: at_ns for place, at_ns in enumerate(begin) if at_ns is not None}
        if len(places) < len(begin):
            raise ValueError("a run whose faults act from the start on has no branch")
        self._left = deque(sorted(places, key=places.__getitem__))
        self._places = places
        self._branches = branches
        self._injections = injections
        self._results: dict[int, Result] = {}
        self._mine: tuple[int, int] | None = None

    @property
    def next_ns(self) -> int | None:
        """See `Source.next_ns`."""
        started_ns = self._injections.timeline.started_ns
        return started_ns + self._places[self._left[0]] if self._left and started_ns is not None else None

    def act(self) -> None:
        """Fork; the trunk waits for the result of its child, and the child goes on with the faults.

        Raises:
            AllBranchedError: In the trunk, after the last one.
        """
        place = self._left.popleft()
        source, sink = os.pipe()
        parent, child = os.getpid(), os.fork()
        if child == 0:
            end_with(parent)
            os.close(source)
            self._left.clear()
            self._mine = place, sink
            self._injections.declare(*self._branches[place])
            return
        os.close(sink)
        self._results[place] = _received(source, child)
        if not self._left:
            raise AllBranchedError("all runs have branched off")

    def run(self, simulate: Callable[[], None], observe: Callable[[int], Result]) -> dict[int, Result]:
        """The result of each run by its place; those are missing that the trunk ended before.

        Args:
            simulate: Makes the trunk, and what follows in each branch.
            observe: What came of a branch, by its place; called in its process, which ends with that.

        Raises:
            RigError: The process of a branch ended without a result; what it raised is on standard error.
        """
        code = _FAILED
        try:
            with contextlib.suppress(AllBranchedError):
                simulate()
            if self._mine is not None:
                place, sink = self._mine
                with open(sink, "wb", closefd=False) as file:  # it ends with the process, which is what is waited for
                    file.write(pickle.dumps(observe(place)))
                code = 0
        except BaseException:
            if self._mine is None:
                raise
            traceback.print_exc()
        finally:
            if self._mine is not None:  # nothing of what the trunk has yet to do is a branch's business
                sys.stderr.flush()
                os._exit(code)
        return self._results


def _received(source: int, child: int) -> Any:  # noqa: ANN401 - whatever was pickled
    """What a child hands over; it has ended then."""
    try:
        with open(source, "rb") as file:
            received = file.read()
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status != 0:
        raise RigError(f"a run of the campaign ended its process with {status}; what it raised is above")
    return pickle.loads(received)  # noqa: S301 - of our own fork
