# SPDX-License-Identifier: MIT
"""`segway-ecc model inspect MODEL`: what a model is."""

import argparse
import itertools
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from segway_ecc.node.cli.options import add_json, add_model, model_failures, print_found
from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import LARGEST, Variable, Write
from segway_ecc.node.models.load import load_model, locate
from segway_ecc.node.native.library import describe
from segway_ecc.node.watchdog.watchdog import model_watchdog

_EFFECT = {
    Write.NOW: "a write takes effect at once",
    Write.STATIC: "a write takes effect at once, through the static equations",
    Write.RESET: "a write takes effect at reset",
    Write.NEVER: "cannot be written",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `inspect`."""
    add_model(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Load the model and print what was found.

    Raises:
        ModelError: A start value is not a number; all is printed all the same.
    """
    source = locate(options.model, [Path()])
    with model_failures(source), model_watchdog(source):
        description = describe(load_model(source, method=options.method, step_size=options.step))
    document = {
        "name": description.name,
        "flavour": str(description.flavour),
        "build": description.build,
        "method": description.method,
        "step_size_s": description.step_size,
        "finish_time_s": description.finish_time,
        "inputs": [_variable(v, Write.NOW) for v in description.inputs],
        "outputs": [_variable(v, Write.NEVER) for v in description.outputs],
        "parameters": [_variable(v, v.write) for v in description.parameters],
        "states": [_variable(v, v.write) for v in description.states],
        "warnings": list(description.warnings),
    }
    finish = description.finish_time
    rows = {
        "model": description.name,
        "flavour": str(description.flavour),
        "build": description.build or "not given",
        "method": description.method or "not known",
        "step": f"{description.step_size:g} s",
        "finish time": "none" if finish is None else f"{finish:g} s, which does not end it here",
    }
    print_found(options, document, rows)
    if not options.json:
        for title, variables in zip(("inputs", "outputs", "parameters", "states"), description.by_kind, strict=True):
            _section(title, variables, writes=title in {"parameters", "states"})
        for warning in description.warnings:
            sys.stderr.write(f"segway-ecc: warning: {warning}\n")
    for variable in itertools.chain.from_iterable(description.by_kind):
        if math.isnan(variable.value):
            raise ModelError(f"the start value of '{variable.name}' of model '{description.name}' is not a number")
    return 0


def _variable(variable: Variable, write: Write) -> dict[str, Any]:
    found: dict[str, Any] = {"name": variable.name, "unit": variable.unit, "value": variable.value, "write": str(write)}
    if variable.why:
        found["why"] = variable.why
    if variable.range_text:
        low, high = variable.minimum, variable.maximum
        found |= {"minimum": None if low == -LARGEST else low, "maximum": None if high == LARGEST else high}
    return {**found, "tunable": True} if variable.tunable else found


def _section(title: str, variables: Sequence[Variable], *, writes: bool) -> None:
    sys.stdout.write(f"\n{title}{'' if variables else ': none'}\n")
    rows = []
    for v in variables:
        effect = f"{_EFFECT[v.write]}: {v.why}" if v.why else _EFFECT[v.write]
        parts = (effect if writes else "", v.range_text, "tunable while armed" if v.tunable else "")
        rows.append((v.name, f"{v.value:g}", v.unit, "; ".join(part for part in parts if part)))
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    for name, value, unit, when in rows:
        line = f"  {name:<{widths[0]}}  {value:>{widths[1]}} {unit:<{widths[2]}}  {when}"
        sys.stdout.write(line.rstrip() + "\n")
