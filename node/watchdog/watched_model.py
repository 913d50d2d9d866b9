# SPDX-License-Identifier: MIT
"""A model each call into which is recorded in the page that its watchdog looks at.

What a call gives is taken within it: a list without end, or a property that never returns, is the model's too. A fork
of the model's that comes back from a call is ended: it would be a second controller, with the first one's files and
identity.
"""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Protocol

from segway_ecc.node.errors import ModelError
from segway_ecc.node.helper import write_message
from segway_ecc.node.model.model import Model
from segway_ecc.node.model.undo import keep_state
from segway_ecc.node.watchdog.page import Call, CallPage


class Counter(Protocol):
    """What knows the number of the present cycle."""

    @property
    def cycle(self) -> int:
        """It."""


class Steps:
    """Counts where there are no cycles."""

    cycle = 0


class WatchedModel:
    """See `segway_ecc.node.model.model.Model`.

    Attributes:
        counter: Knows the number of the present cycle.
        watched_model: The model itself.
        stopped: See `Model.stopped`.
    """

    def __init__(self, model: Model, page: CallPage, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Record the calls into `model` in `page`."""
        self.name, self.step_size = model.name, model.step_size
        self.inputs, self.outputs = model.inputs, model.outputs
        self.parameters, self.states = model.parameters, model.states
        self.counter: Counter = Steps()
        self.watched_model = model
        self.stopped = False
        self._page = page
        self._process = os.getpid()
        self._now_ns = now_ns

    @property
    def inputs_text(self) -> str:
        """The inputs that it was last called with, for people."""
        return self._page.inputs_text([variable.name for variable in self.inputs])

    def initialize(self, u: Sequence[float]) -> list[float]:
        """See `Model.initialize`."""
        self._page.enter_with(Call.INITIALIZE, self.counter.cycle, self._now_ns(), u)
        try:
            return _listed(self.watched_model.initialize(u))
        finally:
            self._leave()

    def step(self, u: Sequence[float]) -> list[float]:
        """See `Model.step`."""
        self._page.enter_with(Call.STEP, self.counter.cycle, self._now_ns(), u)
        try:
            y = _listed(self.watched_model.step(u))
            self.stopped = bool(self.watched_model.stopped)
            return y
        finally:
            self._leave()

    def terminate(self) -> None:
        """See `Model.terminate`."""
        self._enter(Call.TERMINATE)
        try:
            self.watched_model.terminate()
        finally:
            self._leave()

    def read(self, name: str) -> float:
        """See `Model.read`."""
        self._enter(Call.READ)
        try:
            return float(self.watched_model.read(name))
        finally:
            self._leave()

    def write(self, name: str, value: float) -> None:
        """See `Model.write`."""
        self._enter(Call.WRITE)
        try:
            self.watched_model.write(name, value)
        finally:
            self._leave()

    def _enter(self, call: Call) -> None:
        self._page.enter(call, self.counter.cycle, self._now_ns())

    def _leave(self) -> None:
        if os.getpid() != self._process:
            end_fork(self.name)
        self._page.leave()


class WatchedStatefulModel(WatchedModel):
    """One of a model that gives and takes its state itself; see `segway_ecc.node.cycle.state`."""

    watched_model: Any

    def save_state(self) -> bytes:
        """What later steps depend on."""
        self._enter(Call.SAVE)
        try:
            state: bytes = self.watched_model.save_state()
            return state
        finally:
            self._leave()

    def keep_in_process(self) -> Callable[[], None]:
        """See `segway_ecc.node.model.undo.keep_state`."""
        self._enter(Call.SAVE)
        try:
            inner = keep_state(self.watched_model)
        finally:
            self._leave()

        def put_back() -> None:
            self._enter(Call.RESTORE)
            try:
                inner()
            finally:
                self._leave()

        return put_back

    def restore_state(self, data: bytes) -> None:
        """Go on from what `save_state` gave."""
        self._enter(Call.RESTORE)
        try:
            self.watched_model.restore_state(data)
        finally:
            self._leave()


def _listed(given: Any) -> list[float]:  # noqa: ANN401 - what a user's model gives
    return given if type(given) is list else list(given)


def end_fork(name: str) -> NoReturn:
    """End this process, which the model of this name has forked: as one that failed, of which no watchdog is asked."""
    write_message(f"model '{name}' forked the process, and its fork came back from the call: only the fork was ended")
    os._exit(ModelError.exit_code)


def watched(model: Model, page: CallPage, now_ns: Callable[[], int] = time.monotonic_ns) -> WatchedModel:
    """The model with each call into it recorded in `page`; it has a state of its own where the model has."""
    has_state = hasattr(model, "save_state")
    return (WatchedStatefulModel if has_state else WatchedModel)(model, page, now_ns)
