# SPDX-License-Identifier: MIT
"""`segway-ecc model inspect MODEL`: what a model is."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from segway_ecc.node.cli.options import add_json, add_model, print_found
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.models.load import load_model, locate
from segway_ecc.node.native.library import describe

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
    """Load the model and print what was found."""
    model = load_model(locate(options.model, [Path()]), method=options.method, step_size=options.step)
    description = describe(model)
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
    return 0


def _variable(variable: Variable, write: Write) -> dict[str, Any]:
    found = {"name": variable.name, "unit": variable.unit, "value": variable.value, "write": str(write)}
    return {**found, "why": variable.why} if variable.why else found


def _section(title: str, variables: Sequence[Variable], *, writes: bool) -> None:
    sys.stdout.write(f"\n{title}{'' if variables else ': none'}\n")
    rows = []
    for v in variables:
        effect = f"{_EFFECT[v.write]}: {v.why}" if v.why else _EFFECT[v.write]
        rows.append((v.name, f"{v.value:g}", v.unit, effect if writes else ""))
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    for name, value, unit, when in rows:
        line = f"  {name:<{widths[0]}}  {value:>{widths[1]}} {unit:<{widths[2]}}  {when}"
        sys.stdout.write(line.rstrip() + "\n")
