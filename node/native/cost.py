# SPDX-License-Identifier: MIT
"""What a step costs through our interface, beside the same step called from C."""

import importlib.resources
import statistics
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import compile_c
from segway_ecc.node.native.library import NativeModel

_STEPS: Final = 20_000


def step_cost(model: NativeModel) -> dict[str, float]:
    """Measure a model whose library stands alone, as that of generated code does.

    Returns:
        `through_our_interface_s` and `native_s`: medians over many steps, each with the cost of reading the clock, s.

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
        compile_c(["-O2", "-x", "c", "-", "-o", program, "-ldl"], "native_cost.c", source)
        ports = (str(len(model.inputs)), str(len(model.outputs)), str(_STEPS))
        try:
            words = [program, str(model.library_path), *ports]
            native_ns = int(subprocess.check_output(words, stderr=subprocess.DEVNULL))  # noqa: S603 - our own program
        except (OSError, subprocess.CalledProcessError) as error:
            raise ModelError(f"cannot measure model '{model.name}' from C: {error}") from error
    return {"through_our_interface_s": statistics.median(durations) * 1e-9, "native_s": native_ns * 1e-9}
