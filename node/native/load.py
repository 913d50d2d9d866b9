# SPDX-License-Identifier: MIT
"""Loading a model that arrives as generated code or as an FMU."""

import dataclasses
from pathlib import Path

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import repeatability_warnings
from segway_ecc.node.native.fmu.load import load_fmu
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.native.twenty_sim.build import build
from segway_ecc.node.native.twenty_sim.files import read_folder
from segway_ecc.node.native.twenty_sim.model import describe_model
from segway_ecc.node.native.twenty_sim.names import find_ports, read_tables
from segway_ecc.node.native.twenty_sim.parts import find_parts
from segway_ecc.node.native.twenty_sim.shim import make_shim


def load_native(path: Path, *, method: str | None = None, step_size: float | None = None) -> NativeModel:
    """Load a folder of code that 20-sim generated, or an FMU.

    The first time takes as long as its compilation (seconds); after that it is found in the cache by its content.

    Args:
        path: The folder or the .fmu file. It is only read.
        method: The integration method of a partial copy that does not name it: Discrete, Euler, RungeKutta2 or
            RungeKutta4.
        step_size: The step of a partial copy or an FMU that does not give it, s.

    Raises:
        ModelError: The model cannot be loaded; the text gives the reason and what to do.
    """
    if path.suffix.lower() == ".fmu":
        if method is not None:
            raise ModelError(f"{path} is an FMU, which brings its own method: leave it out")
        return load_fmu(path, step_size)
    if not path.is_dir():
        raise ModelError(f"there is no folder {path}: give a folder of 20-sim code, an FMU, or package.module:Class")
    folder = read_folder(path)
    parts = find_parts(folder)
    table = read_tables(folder.tables)
    ports = find_ports(parts, table)
    description = describe_model(parts, table, ports, method, step_size)
    library, warnings = build(parts, *make_shim(parts, description, ports))
    warnings = (*description.warnings, *warnings, *repeatability_warnings(library))
    return NativeModel(dataclasses.replace(description, warnings=warnings), library)
