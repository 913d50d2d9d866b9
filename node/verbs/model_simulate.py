"""`segway-ecc model simulate MODEL`: a model alone, under given inputs, to a table, CSV, MCAP or a plot."""

import argparse
import csv
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.cli.options import add_json, add_model, print_json, print_table
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.model.model import Model
from segway_ecc.node.model.simulate import Sample, simulate
from segway_ecc.node.models.load import load_model
from segway_ecc.node.models.locate import locate
from segway_ecc.node.recording.mcap_log import McapLog, topic_name

_LONGEST_S: Final = 86_400.0
_NS_PER_S: Final = 1_000_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `simulate`."""
    add_model(parser)
    parser.add_argument("--input", action="append", default=[], metavar="NAME=VALUE", help="hold an input")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="set a parameter at the start")
    parser.add_argument("--duration", type=float, required=True, metavar="S", help="how long")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write every sample")
    parser.add_argument("--mcap", type=Path, metavar="FILE", help="write a log for Foxglove and PlotJuggler")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the outputs (.svg, .png, .pdf)")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Simulate, write what was asked for, and print where the model ended."""
    if not 0.0 < options.duration <= _LONGEST_S:
        raise ConfigurationError(f"--duration must be more than 0 s and at most {_LONGEST_S:g} s")
    parameters = _assignments("--set", options.set)
    model = load_model(locate(options.model, [Path()]), parameters, method=options.method, step_size=options.step)
    samples = list(simulate(model, _assignments("--input", options.input), options.duration))
    if options.csv is not None:
        _write_csv(options.csv, model, samples)
    if options.mcap is not None:
        _write_mcap(options.mcap, model, samples)
    if options.plot is not None:
        _draw(options.plot, model, samples)
    last = samples[-1]
    outputs = {v.name: value for v, value in zip(model.outputs, last.y, strict=True)}
    if options.json:
        print_json({"time_s": last.time, "outputs": outputs})
    else:
        units = {v.name: v.unit for v in model.outputs}
        texts = {name: f"{value:.6g} {units[name]}" for name, value in outputs.items()}
        print_table({"time": f"{last.time:g} s", **texts})
    return 0


def _assignments(option: str, texts: Sequence[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        name, separator, value = text.rpartition("=")
        try:
            found[name] = float(value)
        except ValueError:
            separator = ""
        if not separator:
            raise ConfigurationError(f"{option} wants NAME=VALUE with a number, not '{text}'")
    return found


def _write_csv(path: Path, model: Model, samples: Sequence[Sample]) -> None:
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *(v.name for v in model.inputs), *(v.name for v in model.outputs)])
            writer.writerows([sample.time, *sample.u, *sample.y] for sample in samples)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error


def _write_mcap(path: Path, model: Model, samples: Sequence[Sample]) -> None:
    topics = [topic_name("model", v.name) for v in (*model.inputs, *model.outputs)]
    with McapLog(path) as log:
        for sample in samples:
            for name, value in zip(topics, (*sample.u, *sample.y), strict=True):
                log.float64(name, round(sample.time * _NS_PER_S), value)


def _draw(path: Path, model: Model, samples: Sequence[Sample]) -> None:
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigurationError("--plot needs a drawing library: install 'segway-ecc[report]'")
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra that the rest of this verb does without

    figure = Figure(figsize=(8, 1.2 + 1.8 * len(model.outputs)), layout="constrained")
    panels = figure.subplots(max(len(model.outputs), 1), 1, sharex=True, squeeze=False)[:, 0]
    times = [sample.time for sample in samples]
    for index, (panel, variable) in enumerate(zip(panels, model.outputs, strict=False)):
        panel.plot(times, [sample.y[index] for sample in samples])
        panel.set_ylabel(variable.name if variable.unit == "1" else f"{variable.name}, {variable.unit}")
        panel.grid(visible=True)
    panels[-1].set_xlabel("time, s")
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"cannot draw {path}: {error}") from error
