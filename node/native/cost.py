# SPDX-License-Identifier: MIT
"""What a step costs through our interface, beside the same step called from C."""

import importlib.resources
import statistics
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.library import NativeModel

_STEPS: Final = 20_000


@dataclass(frozen=True, slots=True)
class StepCost:
    """Medians over many steps, each with the cost of reading the clock, s."""

    through_our_interface_s: float
    native_s: float


def step_cost(model: NativeModel) -> StepCost:
    """Measure a model whose library stands alone, as that of generated code does.

    Raises:
        ModelError: The C side cannot be compiled or run.
    """
    u = [v.value for v in model.inputs]
    model.initialize(u)
    durations = []
    for _ in range(_STEPS):
        start = time.perf_counter_ns()
        model.step(u)
        durations.append(time.perf_counter_ns() - start)
    source = importlib.resources.files("segway_ecc.node.native").joinpath("native_cost.c").read_bytes()
    with tempfile.TemporaryDirectory(prefix="segway-ecc-cost-") as name:
        program = str(Path(name) / "native_cost")
        _run(["gcc", "-O2", "-x", "c", "-", "-o", program, "-ldl"], model, source)
        ports = (str(len(model.inputs)), str(len(model.outputs)), str(_STEPS))
        native_ns = int(_run([program, str(model.library_path), *ports], model))
    return StepCost(statistics.median(durations) * 1e-9, native_ns * 1e-9)


def _run(command: Sequence[str], model: NativeModel, source: bytes | None = None) -> bytes:
    try:
        return subprocess.run(command, input=source, check=True, capture_output=True).stdout  # noqa: S603 - our own words
    except (OSError, subprocess.CalledProcessError) as error:
        raise ModelError(f"cannot measure model '{model.name}' from C: {error}") from error
