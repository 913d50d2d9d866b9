# SPDX-License-Identifier: MIT
"""A compiled model: one shared object with our own C interface, loaded once per instance.

The interface is the same for every flavour; a shim of ours, compiled with the model or before an FMU, provides it:

    int32_t ecc_initialize(const double *u, double *y);   initial and static equations at time zero
    int32_t ecc_step(const double *u, double *y);         one step under u; 0 done, 1 the model asked to stop
    int32_t ecc_terminate(void);                          final equations
    int32_t ecc_static(void);                             static equations again
    double ecc_read(int32_t kind, int32_t index);
    int32_t ecc_write(int32_t kind, int32_t index, double value);
    const char *ecc_error(void);                          why the last call failed

and, where the model's memory can be told from the rest,

    int32_t ecc_save(uint64_t *words, int32_t most);      its state, two words a piece; returns how many pieces
    int32_t ecc_load(const uint64_t *words, int32_t count);

A negative return is a failure. `kind` is a `Kind`, `index` the place in the description's order.
"""

import ctypes
import enum
import hashlib
import shutil
import struct
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.node.errors import ModelError, UnknownNameError
from segway_ecc.node.model.model import Model, Variable, Write, refusal_of

_WORD: Final = 16
_MOST_WORDS: Final = 3000
"""Of a state, so that a snapshot holds it."""


@enum.unique
class Flavour(enum.StrEnum):
    """The shapes in which models arrive."""

    PYTHON = "python"
    """A class of our own."""
    C_SUBMODEL = "20-sim C submodel"
    """Process globals: xxsubmod, xxmodel, xxinteg and their companions."""
    CPP_CLASS = "20-sim C++ class"
    C_PARTIAL = "20-sim C, partial copy"
    """xxmodel and its companions without xxsubmod."""
    FMI2 = "FMI 2.0 co-simulation"
    FMI3 = "FMI 3.0 co-simulation"


@dataclass(frozen=True, slots=True)
class Description:
    """A model as found.

    Attributes:
        build: What generated it, as it states; empty where it does not.
        method: The integration method, under the name its generator gives it; empty where it is not known.
        step_size: Length of one step, s.
        finish_time: End of the experiment that is baked in, s; None where there is none. It does not end the model.
        inputs, outputs: The ports, in the order of u and of y.
        parameters, states: With the values that the code gives them, at the start.
        warnings: What a user should know before trusting it, a line each.
    """

    name: str
    flavour: Flavour
    build: str
    method: str
    step_size: float
    finish_time: float | None
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    states: tuple[Variable, ...]
    warnings: tuple[str, ...] = ()

    @property
    def by_kind(self) -> tuple[tuple[Variable, ...], ...]:
        """All variables, in the order of `Kind`."""
        return self.inputs, self.outputs, self.parameters, self.states


@enum.unique
class Kind(enum.IntEnum):
    """What an index counts."""

    INPUT = 0
    OUTPUT = 1
    PARAMETER = 2
    STATE = 3


class NativeModel:
    """A `Model` whose equations are machine code; see `segway_ecc.node.model.model.Model`.

    Attributes:
        description: Everything that was found out about it; what `Model` asks for stands beside it.
        library_path: The shared object that it was loaded from.
        stopped: Whether the model has asked to stop.
    """

    def __init__(self, description: Description, library: Path) -> None:
        """Load a private copy of a shared object that has the interface above.

        A copy, since the loader gives two users of one file the same globals.

        Raises:
            ModelError: The library cannot be loaded.
        """
        self.description = description
        self.name, self.step_size = description.name, description.step_size
        self.inputs: Sequence[Variable] = description.inputs
        self.outputs: Sequence[Variable] = description.outputs
        self.parameters: Sequence[Variable] = description.parameters
        self.states: Sequence[Variable] = description.states
        self.library_path = library
        self.stopped = False
        self._library = _load_copy(library)
        self._u = (ctypes.c_double * max(len(description.inputs), 1))()
        self._y = (ctypes.c_double * max(len(description.outputs), 1))()
        self._inputs = len(description.inputs)
        self._fill = struct.Struct(f"{self._inputs}d").pack_into
        self._shown = struct.Struct(f"{len(description.outputs)}d").unpack_from
        self._places = {
            variable.name: (kind, index, variable)
            for kind in (Kind.OUTPUT, Kind.INPUT, Kind.STATE, Kind.PARAMETER)
            for index, variable in enumerate(description.by_kind[kind])
        }
        self._hash = hashlib.sha256(library.read_bytes()).hexdigest()[:16]
        self._words = (ctypes.c_char * (_WORD * _MOST_WORDS))() if hasattr(self._library, "ecc_save") else None
        # Without declared types, and with references made once: what ctypes converts in a call costs more than a step.
        self._step = self._library["ecc_step"]
        self._arguments = ctypes.byref(self._u), ctypes.byref(self._y)

    def initialize(self, u: Sequence[float]) -> list[float]:
        """Start at time zero; see `Model.initialize`."""
        self._set_inputs(u)
        self.stopped = False
        self._check(self._library.ecc_initialize(self._u, self._y), "initialize")
        return list(self._shown(self._y))

    def step(self, u: Sequence[float]) -> list[float]:
        """Advance one step; see `Model.step`."""
        self._set_inputs(u)
        status = self._step(*self._arguments)
        if status:
            self._check(status, "step")
            self.stopped = True
        return list(self._shown(self._y))

    def terminate(self) -> None:
        """Run the final section."""
        self._check(self._library.ecc_terminate(), "terminate")

    def read(self, name: str) -> float:
        """Return a present value; see `Model.read`."""
        kind, index, _ = self._find(name)
        return float(self._library.ecc_read(kind, index))

    def write(self, name: str, value: float) -> None:
        """Write a parameter or state; see `Model.write`."""
        kind, index, variable = self._find(name)
        if kind in (Kind.INPUT, Kind.OUTPUT) or variable.write is Write.NEVER:
            raise ModelError(f"'{name}' of model '{self.name}' cannot be written: {variable.why or 'it is a port'}")
        if refusal := refusal_of(variable, value):
            raise ModelError(refusal)
        before = self._library.ecc_read(kind, index)
        try:
            self._check(self._library.ecc_write(kind, index, value), f"write '{name}'")
            if variable.write is Write.STATIC:
                self._check(self._library.ecc_static(), "run its static equations again")
        except ModelError:  # refused whole
            self._library.ecc_write(kind, index, before)
            raise

    def save_state(self) -> bytes:
        """What later steps depend on; a ModelError where it cannot be given. See `segway_ecc.node.cycle.state`."""
        if self._words is None:
            raise ModelError(f"an {self.description.flavour} does not give it")
        count = self._library.ecc_save(self._words, _MOST_WORDS)
        self._check(count, "give its state")
        memory = ctypes.string_at(self._words, _WORD * count)
        return msgspec.msgpack.encode({f"memory of {self._hash}": memory, "stopped": self.stopped})

    def restore_state(self, data: bytes) -> None:
        """Go on from what `save_state` gave; a ModelError where that is not of this model as it is compiled here."""
        held = msgspec.msgpack.decode(data, type=dict[str, bytes | bool])
        memory, self.stopped = held.get(f"memory of {self._hash}"), bool(held.get("stopped"))
        if self._words is None or not isinstance(memory, bytes) or len(memory) % _WORD:
            raise ModelError("it is of a model that was compiled otherwise")
        self._check(self._library.ecc_load(memory, len(memory) // _WORD), "take its state back")

    def _set_inputs(self, u: Sequence[float]) -> None:
        if len(u) != self._inputs:
            raise ModelError(f"model '{self.name}' has {self._inputs} inputs and was given {len(u)}")
        self._fill(self._u, 0, *u)

    def _find(self, name: str) -> tuple[Kind, int, Variable]:
        if name not in self._places:
            raise UnknownNameError(f"variable of model '{self.name}'", name, self._places)
        return self._places[name]

    def _check(self, status: int, what: str) -> None:
        if status < 0:
            reason = (self._library.ecc_error() or b"it gives no reason").decode(errors="replace")
            raise ModelError(f"model '{self.name}' failed to {what}: {reason}")


def describe(model: Model) -> Description:
    """The description of a model; a model of our own in Python describes itself."""
    if isinstance(model, NativeModel):
        return model.description
    kind = type(model)
    return Description(
        name=model.name,
        flavour=Flavour.PYTHON,
        build=f"{kind.__module__}:{kind.__qualname__}",
        method=str(getattr(model, "method", "")),
        step_size=model.step_size,
        finish_time=None,
        inputs=tuple(model.inputs),
        outputs=tuple(model.outputs),
        parameters=tuple(model.parameters),
        states=tuple(model.states),
    )


def _load_copy(library: Path) -> ctypes.CDLL:
    with tempfile.TemporaryDirectory(prefix="segway-ecc-model-") as folder:
        copy = Path(folder) / library.name
        try:
            shutil.copy2(library, copy)
            # Local symbols only: two models in one process must not see each other.
            loaded = ctypes.CDLL(str(copy), mode=ctypes.RTLD_LOCAL)
        except OSError as error:
            raise ModelError(f"cannot load the compiled model {library}: {error}") from error
    numbers = ctypes.POINTER(ctypes.c_double)
    try:
        loaded.ecc_initialize.argtypes = loaded.ecc_step.argtypes = (numbers, numbers)
        loaded.ecc_terminate.argtypes = loaded.ecc_static.argtypes = loaded.ecc_error.argtypes = ()
        loaded.ecc_read.argtypes = (ctypes.c_int32, ctypes.c_int32)
        loaded.ecc_write.argtypes = (ctypes.c_int32, ctypes.c_int32, ctypes.c_double)
        loaded.ecc_read.restype = ctypes.c_double
        loaded.ecc_error.restype = ctypes.c_char_p
    except AttributeError as error:
        text = f"the compiled model {library} lacks our interface; clear the cache and load it again"
        raise ModelError(text) from error
    return loaded
