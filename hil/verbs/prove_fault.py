# SPDX-License-Identifier: MIT
"""`segway-ecc prove fault`: run one declared scenario in lock step, and see whether it comes as expected."""

import argparse
from pathlib import Path

import msgspec

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import (
    ScenarioRun,
    check_parameter,
    details,
    load_all,
    load_scenario,
)
from segway_ecc.hil.verbs.proofs import add_floor, check_floor
from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.errors import ConfigurationError, plain_number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `hil`."""
    parser.add_argument("scenario", nargs="?", help="a scenario file, or the name of one that ships with the package")
    parser.add_argument("--list", action="store_true", help="list the scenarios that ship with the package")
    parser.add_argument("--robot", metavar="ROBOT", help="the robot; the scenario's first where not given")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="the seed of chance; the scenario's first where not given"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="K=V",
        help="a parameter, plant.NAME or model.NAME (may be given again), in place of the scenario's first set",
    )
    add_floor(parser)
    parser.add_argument("--log", type=Path, metavar="FILE", help="write the robot's log (MCAP)")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Run the scenario and print what came of it: 0 as expected, 1 not."""
    if options.list:
        scenarios = dict(load_all([]))
        listed = {name: f"{scenario.expect.outcome}: {scenario.about}" for name, scenario in scenarios.items()}
        print_found(options, msgspec.to_builtins(list(scenarios.values())), listed)
        return 0
    if options.scenario is None:
        raise ConfigurationError("which scenario? `segway-ecc prove fault --list` lists those of the package")
    if options.seed is not None and options.seed < 0:
        raise ConfigurationError(f"--seed must not be negative, not {options.seed}")
    check_floor(options)
    scenario = load_scenario(options.scenario)
    seed = scenario.seeds[0] if options.seed is None else options.seed
    parameters = parameters_of(options.set) if options.set else scenario.parameters[0]
    robot = options.robot or scenario.robots[0]
    trial = ScenarioRun(options.scenario, scenario, robot, seed, parameters, options.floor)
    result = run_scenario(trial, options.log)
    document = {**msgspec.to_builtins(result), "as_expected": result.is_as_expected, "command": result.command}
    print_found(options, document, details(result))
    return 0 if result.is_as_expected else 1


def parameters_of(words: list[str]) -> dict[str, float]:
    """Parameters by name, from `NAME=VALUE`.

    Raises:
        ConfigurationError: One is not like that.
    """
    parameters = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            check_parameter(name)
            number = plain_number(value)
        except ValueError as error:
            raise ConfigurationError(f"--set {word}: {error}; write plant.NAME=VALUE or model.NAME=VALUE") from error
        if name in parameters:
            raise ConfigurationError(f"--set names '{name}' twice")
        parameters[name] = number
    return parameters
