# SPDX-License-Identifier: MIT
"""`segway-ecc model simulate MODEL`: a model alone, under given inputs, to a table, CSV, MCAP or a plot."""

import argparse
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.cli.options import (
    add_json,
    add_model,
    check_seconds,
    count_steps,
    drawing_file,
    model_failures,
    output_file,
    print_found,
    write_csv,
)
from segway_ecc.node.cli.panels import Signal, draw_panels
from segway_ecc.node.errors import ConfigurationError, ModelFailedError, plain_number
from segway_ecc.node.model.model import Model, Sample, simulate
from segway_ecc.node.models.load import load_model, locate
from segway_ecc.node.recording.mcap_log import McapLog, topic_name
from segway_ecc.node.safety.limiter import not_finite
from segway_ecc.node.watchdog.watchdog import model_watchdog
from segway_ecc.node.watchdog.watched_model import Steps

_LONGEST_S: Final = 86_400.0
_NS_PER_S: Final = 1_000_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `simulate`."""
    add_model(parser)
    parser.add_argument("--input", action="append", default=[], metavar="NAME=VALUE", help="hold an input")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="set a parameter at the start")
    parser.add_argument("--duration", type=float, required=True, metavar="S", help="how long")
    parser.add_argument("--csv", type=output_file, metavar="FILE", help="write every sample")
    parser.add_argument("--mcap", type=output_file, metavar="FILE", help="write a log for Foxglove and PlotJuggler")
    parser.add_argument("--plot", type=drawing_file, metavar="FILE", help="draw the outputs (.svg, .png, .pdf)")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Simulate, write what was asked for, and print where the model ended.

    Raises:
        ModelFailedError: An output is not finite; what was asked for is written and printed all the same.
    """
    check_seconds(options, "duration", _LONGEST_S)
    parameters, held = _assignments("--set", options.set), _assignments("--input", options.input)
    source = locate(options.model, [Path()])
    steps, failure = Steps(), None
    kept = None if options.csv or options.mcap or options.plot else 1
    samples: deque[Sample] = deque(maxlen=kept)
    with model_failures(source), model_watchdog(source) as watchdog:
        model = watchdog.watch(load_model(source, parameters, method=options.method, step_size=options.step))
        model.counter = steps
        count_steps("duration", options.duration, model.step_size)
        for sample in simulate(model, held, options.duration):
            samples.append(sample)
            steps.cycle += 1
            failure = failure or _not_finite_output(model, sample)
    if options.csv is not None:
        header = ["time", *(v.name for v in (*model.inputs, *model.outputs))]
        write_csv(options.csv, header, ([sample.time, *sample.u, *sample.y] for sample in samples))
    if options.mcap is not None:
        topics = [topic_name("model", v.name) for v in (*model.inputs, *model.outputs)]
        with McapLog(options.mcap) as log:
            for sample in samples:
                for name, value in zip(topics, (*sample.u, *sample.y), strict=True):
                    log.float64(name, round(sample.time * _NS_PER_S), value)
    if options.plot is not None:
        drawn = [Signal(v.name, v.unit, [[s.y[index] for s in samples]]) for index, v in enumerate(model.outputs)]
        draw_panels(options.plot, [sample.time for sample in samples], drawn)
    last = samples[-1]
    outputs = {v.name: value for v, value in zip(model.outputs, last.y, strict=True)}
    texts = {v.name: f"{outputs[v.name]:.6g} {v.unit}" for v in model.outputs}
    print_found(options, {"time_s": last.time, "outputs": outputs}, {"time": f"{last.time:g} s", **texts})
    if failure is not None:
        raise ModelFailedError(failure)
    return 0


def _not_finite_output(model: Model, sample: Sample) -> str | None:
    place = not_finite(sample.y)
    if place is None:
        return None
    output = f"output '{model.outputs[place].name}' of model '{model.name}'"
    return f"{output} is not finite: {sample.y[place]} at {sample.time:g} s"


def _assignments(option: str, texts: Sequence[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        name, separator, value = text.rpartition("=")
        try:
            number = plain_number(value)
        except ValueError:
            separator = ""
        if not separator:
            raise ConfigurationError(f"{option} wants NAME=VALUE with a number, not '{text}'")
        if name in found:
            raise ConfigurationError(f"{option} names '{name}' twice")
        found[name] = number
    return found
