# SPDX-License-Identifier: MIT
"""A model each call into which is recorded in the page that its watchdog looks at."""

import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

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
    """

    def __init__(self, model: Model, page: CallPage, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Record the calls into `model` in `page`."""
        self.name, self.step_size = model.name, model.step_size
        self.inputs, self.outputs = model.inputs, model.outputs
        self.parameters, self.states = model.parameters, model.states
        self.counter: Counter = Steps()
        self.watched_model = model
        self._page = page
        self._now_ns = now_ns

    @property
    def inputs_text(self) -> str:
        """The inputs that it was last called with, for people."""
        return self._page.inputs_text([variable.name for variable in self.inputs])

    @property
    def stopped(self) -> bool:
        """See `Model.stopped`."""
        return self.watched_model.stopped

    def initialize(self, u: Sequence[float]) -> list[float]:
        """See `Model.initialize`."""
        self._page.enter_with(Call.INITIALIZE, self.counter.cycle, self._now_ns(), u)
        try:
            return self.watched_model.initialize(u)
        finally:
            self._page.leave()

    def step(self, u: Sequence[float]) -> list[float]:
        """See `Model.step`."""
        page = self._page
        page.enter_with(Call.STEP, self.counter.cycle, self._now_ns(), u)
        try:
            return self.watched_model.step(u)
        finally:
            page.leave()

    def terminate(self) -> None:
        """See `Model.terminate`."""
        self._enter(Call.TERMINATE)
        try:
            self.watched_model.terminate()
        finally:
            self._page.leave()

    def read(self, name: str) -> float:
        """See `Model.read`."""
        self._enter(Call.READ)
        try:
            return self.watched_model.read(name)
        finally:
            self._page.leave()

    def write(self, name: str, value: float) -> None:
        """See `Model.write`."""
        self._enter(Call.WRITE)
        try:
            self.watched_model.write(name, value)
        finally:
            self._page.leave()

    def _enter(self, call: Call) -> None:
        self._page.enter(call, self.counter.cycle, self._now_ns())


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
            self._page.leave()

    def keep_in_process(self) -> Callable[[], None]:
        """See `segway_ecc.node.model.undo.keep_state`."""
        self._enter(Call.SAVE)
        try:
            inner = keep_state(self.watched_model)
        finally:
            self._page.leave()

        def put_back() -> None:
            self._enter(Call.RESTORE)
            try:
                inner()
            finally:
                self._page.leave()

        return put_back

    def restore_state(self, data: bytes) -> None:
        """Go on from what `save_state` gave."""
        self._enter(Call.RESTORE)
        try:
            self.watched_model.restore_state(data)
        finally:
            self._page.leave()


def watched(model: Model, page: CallPage, now_ns: Callable[[], int] = time.monotonic_ns) -> WatchedModel:
    """The model with each call into it recorded in `page`; it has a state of its own where the model has."""
    has_state = hasattr(model, "save_state")
    return (WatchedStatefulModel if has_state else WatchedModel)(model, page, now_ns)
