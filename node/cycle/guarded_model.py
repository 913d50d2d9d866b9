# SPDX-License-Identifier: MIT
"""Every call into a model, which may raise anything: what it raises names the model, the cycle and the call."""

import signal
from collections.abc import Callable, Sequence
from typing import Any

from segway_ecc.node.errors import ModelError, ModelFailedError, failure_text
from segway_ecc.node.model.model import Model
from segway_ecc.node.safety.limiter import not_finite


class GuardedModel:
    """A model as the cycle calls it.

    Whatever a call raises, SystemExit too, becomes a `ModelFailedError`; Ctrl-C, where Python makes an exception of it,
    passes. So do outputs that are not numbers, or not as many as the model has, which would fail where they are used.

    Attributes:
        model: The model itself.
        cycle: The number of the present cycle, for messages; None before the first.
        u: What the model was last given, in the order of its inputs; empty before that.
        stopped: Whether it has asked to stop.
        bad_output: The place of the first of its newest outputs that is not finite; None where all are.
        failure: The first failure; empty where there was none.
    """

    def __init__(self, model: Model) -> None:
        self.model: Any = model  # whatever its methods promise, a user's may return anything
        self.name = model.name
        self.cycle: int | None = None
        self.u: Sequence[float] = ()
        self.stopped = False
        self.bad_output: int | None = None
        self.failure = ""
        self._outputs = len(model.outputs)
        self._has_begun = False

    def initialize(self, u: Sequence[float]) -> list[float]:
        """See `Model.initialize`."""
        self._has_begun = True
        self.u = u
        try:
            return self._checked(self.model.initialize(u))
        except BaseException as error:
            raise self._failed(error, "in its initial equations") from error

    def step(self, u: Sequence[float]) -> list[float]:
        """See `Model.step`."""
        self.u = u
        try:
            y = self._checked(self.model.step(u))
            self.stopped = self.model.stopped
        except BaseException as error:
            raise self._failed(error, "while running") from error
        return y

    def read(self, name: str) -> float:
        """See `Model.read`."""
        try:
            return float(self.model.read(name))
        except BaseException as error:
            raise self._failed(error, f"when '{name}' was read") from error

    def write(self, name: str, value: float) -> None:
        """See `Model.write`; a value that the model refuses is a failure here."""
        try:
            self.model.write(name, value)
        except BaseException as error:
            raise self._failed(error, f"when '{name}' was set to {value}") from error

    def refuses(self, name: str, value: float, old: float) -> bool:
        """Whether a state does not take a value; it is left as it is, or with its `old` one."""
        try:
            self.model.write(name, value)
        except (Exception, SystemExit):  # noqa: BLE001 - a user's model may raise anything
            self.write(name, old)
            return True
        return False

    def change(self, write: Callable[[], str]) -> str:
        """Have variables written by `VariableWriter.write`; why it was refused, which is no failure."""
        try:
            return write()
        except BaseException as error:
            raise self._failed(error, "when a write was taken back") from error

    def terminate(self) -> None:
        """See `Model.terminate`; nothing where the model was never initialized."""
        if not self._has_begun:
            return
        try:
            self.model.terminate()
        except BaseException as error:
            raise self._failed(error, "in its final equations") from error

    def _checked(self, given: Any) -> list[float]:  # noqa: ANN401 - as above
        y: list[float] = given if type(given) is list else list(given)
        if len(y) != self._outputs:
            raise ModelError(f"it has {self._outputs} outputs and gave {len(y)}")
        self.bad_output = not_finite(y)
        return y

    def _failed(self, error: BaseException, when: str) -> BaseException:
        if isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            return error
        cycle = "" if self.cycle is None else f" in cycle {self.cycle}"
        failed = ModelFailedError(f"model '{self.name}' failed{cycle} {when}: {failure_text(error)}")
        self.failure = self.failure or str(failed)
        return failed
