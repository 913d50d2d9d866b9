# SPDX-License-Identifier: MIT
"""Under which conditions the programs run: the same for all of them, and reported."""

import contextlib
import os
import resource
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from segway_ecc.node.cycle import cycle
from segway_ecc.node.cycle.real_time import (
    IDLE_LATENCY,
    PRIORITY,
    isolated_processors,
    no_deep_idle,
    real_time_priority,
)

PLANT_PRIORITY: Final = PRIORITY + 10
"""Above the loops: a real board is not kept waiting by what commands it."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """What every program has, where this machine gives it.

    Attributes:
        priority: Of SCHED_FIFO; 0 where it is not to be had.
        idle_states_off: Whether the processors are kept from their sleeping states while the programs run.
        memory_locked: Whether their memory is.
        cores: Cores that they may use.
        isolated: Those that were set aside for them; empty where none were.
        kernel: Its release and kind.
        is_compiled: Whether our own loop is, which the others have no choice in.
        is_subscribed: Whether a subscriber receives what they publish.
    """

    priority: int
    idle_states_off: bool
    memory_locked: bool
    cores: int
    isolated: tuple[int, ...]
    kernel: str
    is_compiled: bool = False
    is_subscribed: bool = False

    @property
    def plant_priority(self) -> int:
        """Of SCHED_FIFO, for the plant."""
        return PLANT_PRIORITY if self.priority else 0

    def as_text(self) -> str:
        """One line."""
        facts = [
            f"SCHED_FIFO {self.priority}" if self.priority else "ordinary scheduling (no real-time priority)",
            "idle states off" if self.idle_states_off else f"idle states on ({IDLE_LATENCY} is not to be had)",
            "memory locked" if self.memory_locked else "memory not locked",
            f"{self.cores} cores",
            f"isolated {self.isolated}" if self.isolated else "none isolated",
            f"Linux {self.kernel}",
            "with a subscriber" if self.is_subscribed else "without subscribers",
        ]
        ours = "compiled" if self.is_compiled else "not compiled"
        return f"{', '.join(facts)}; the same for all programs; ours is {ours}"


@contextlib.contextmanager
def held_conditions(*, is_subscribed: bool = False) -> Iterator[Conditions]:
    """Hold while the programs run what is held for all of them: no processor may go to sleep.

    Args:
        is_subscribed: Whether what they publish has a subscriber, which the caller starts.
    """
    with contextlib.ExitStack() as stack:
        with real_time_priority() as refusal:
            priority = 0 if refusal else PRIORITY
        uname = os.uname()
        yield Conditions(
            priority=priority,
            idle_states_off=stack.enter_context(no_deep_idle()) is None,
            memory_locked=resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY,
            cores=len(os.sched_getaffinity(0)),
            isolated=tuple(sorted(isolated_processors())),
            kernel=f"{uname.release}{' PREEMPT_RT' if 'PREEMPT_RT' in uname.version else ''}",
            is_compiled=not cycle.__file__.endswith(".py"),
            is_subscribed=is_subscribed,
        )
