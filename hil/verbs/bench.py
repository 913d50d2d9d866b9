# SPDX-License-Identifier: MIT
"""`segway-ecc bench`: how fast this machine runs the loop, beside what else could be run in its place."""

import argparse
import dataclasses
import itertools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from segway_ecc.hil.bench import table
from segway_ecc.hil.bench.comparison import SEARCHED, ComparisonSetup, compare, search
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.rig import choose_bus, held_conditions, own_cache
from segway_ecc.hil.bench.speed import campaign_speed, links_cost, lock_step, model_step
from segway_ecc.hil.kernels import uml
from segway_ecc.hil.latency.measure import Where, measure, other_host, other_host_lacks
from segway_ecc.hil.verbs.proofs import check_counts
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.native.compile import missing_compiler
from segway_ecc.node.ros.runtime import missing_packages

_FULL_HOLD_S: Final = 30.0
_FULL_DURATION_S: Final = 10.0
_LEAST_S: Final = 1.0
_TRIALS: Final = 100
_FULL_TRIALS: Final = 1000
_AT_ONCE: Final = "immediately"
_ACTUATE: Final = (_AT_ONCE, "next_cycle")


class _Part(NamedTuple):
    """What a part of the bench found: as JSON, for people, and what was to be judged by it."""

    document: object
    text: str
    claims: Sequence[table.Claim] = ()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `bench`."""
    add_json(parser)
    parser.add_argument("--only", nargs="+", choices=list(_PARTS), metavar="PART", help=f"of {', '.join(_PARTS)}")
    everyone = [str(who) for who in Contestant]
    parser.add_argument(
        "--programs", nargs="+", choices=everyone, default=everyone, metavar="WHO", help=f"of {', '.join(everyone)}"
    )
    parser.add_argument(
        "--rate", type=float, nargs="+", default=[100.0, 1000.0], metavar="HZ", help="of the loops (default: 100 1000)"
    )
    parser.add_argument("--duration", type=float, default=2.0, metavar="S", help="of each of their runs (default: 2)")
    parser.add_argument("--repeats", type=int, default=4, metavar="N", help="runs of each program (default: 4)")
    parser.add_argument(
        "--hold", type=float, default=1.5, metavar="S", help="how long each rate is held (default: 1.5)"
    )
    parser.add_argument("--full", action="store_true", help="rates held for 30 s, runs of 10 s: half an hour in all")
    parser.add_argument("--channel", help="CAN interface of the programs (default: a virtual one, else a local bus)")
    parser.add_argument("--plant-channel", metavar="CHANNEL", help="of the plant, where that is another controller")
    parser.add_argument("--subscribed", action="store_true", help="with a subscriber to odom and joint_states")
    parser.add_argument("--check", action="store_true", help="end with 1 where a ratio is not what it is to be")


def run(options: argparse.Namespace) -> int:
    """Measure, and print what was measured."""
    _check(options)
    wanted = options.only or list(_PARTS)
    found: dict[str, _Part] = {}
    for name in wanted:
        _report(name)
        found[name] = _PARTS[name](options)
        if not options.json:
            sys.stdout.write(found[name].text + "\n")
            sys.stdout.flush()
    if options.json:
        print_json(options, {name: part.document for name, part in found.items()})
    judged = [claim for part in found.values() for claim in part.claims]
    return 1 if options.check and not all(claim.is_met for claim in judged) else 0


def _check(options: argparse.Namespace) -> None:
    for name in ("duration", "hold"):
        if not getattr(options, name) >= _LEAST_S:
            raise ConfigurationError(f"--{name} must be at least {_LEAST_S:g} s, not {getattr(options, name)}")
    for rate_hz in options.rate:
        if not 1.0 <= rate_hz <= 1e5:  # noqa: PLR2004 - Hz, as the message has it
            raise ConfigurationError(f"--rate must be 1 to 100000 Hz, not {rate_hz:g}")
    check_counts(options, "repeats")
    if options.subscribed and missing_packages():
        raise ConfigurationError(f"--subscribed needs ROS 2: {', '.join(missing_packages())} is not there")


def _report(what: str) -> None:
    sys.stderr.write(f"segway-ecc: {what}\n")


def _contestants(options: argparse.Namespace, of: Sequence[Contestant] = tuple(Contestant)) -> list[Contestant]:
    """Those of some programs that are wanted and run here; the user's loop is one for ROS."""
    wanted = [who for who in of if who in options.programs]
    lacking = missing_packages() if {Contestant.OURS, Contestant.USER} & set(wanted) else []
    if lacking:
        _report(f"no ROS 2 here ({', '.join(lacking)}): ours runs without it, and the user's loop not at all")
    return [who for who in wanted if not (lacking and who is Contestant.USER)]


def _on_the_rig(
    measure: Callable[[argparse.Namespace, ComparisonSetup], _Part],
) -> Callable[[argparse.Namespace], _Part]:
    """A part that compares programs on the bus, where there is a compiler for them."""

    def part(options: argparse.Namespace) -> _Part:
        lack = missing_compiler()
        if lack is not None:
            return _Part(None, f"comparison: {lack}")
        bus = choose_bus(options.channel, options.plant_channel)
        with own_cache(), held_conditions(is_subscribed=options.subscribed) as conditions:
            found = measure(options, ComparisonSetup(bus, conditions, _report))
        where = f"{bus.interface} {bus.channel}"
        document = {"conditions": dataclasses.asdict(conditions), "bus": where, **msgspec.to_builtins(found.document)}
        return _Part(document, f"on {where}: {conditions.as_text()}\n{found.text}", found.claims)

    return part


@_on_the_rig
def _loops(options: argparse.Namespace, setup: ComparisonSetup) -> _Part:
    duration_s = _FULL_DURATION_S if options.full else options.duration
    rates, texts, judged = [], [], list[table.Claim]()
    for rate_hz in options.rate:
        results = compare(setup, rate_hz, duration_s, options.repeats, _contestants(options))
        found = table.claims(results)
        texts += [f"at {rate_hz:g} Hz", table.comparison_text(results), *(claim.as_text() for claim in found)]
        verdicts = [{**dataclasses.asdict(claim), "met": claim.is_met} for claim in found]
        programs = {who: dataclasses.asdict(result) for who, result in results.items()}
        rates.append({"rate_hz": rate_hz, "programs": programs, "claims": verdicts})
        judged += found
    return _Part({"rates": rates}, "\n".join(texts), judged)


@_on_the_rig
def _held(options: argparse.Namespace, setup: ComparisonSetup) -> _Part:
    hold_s = _FULL_HOLD_S if options.full else options.hold
    held = search(setup, hold_s, _contestants(options, SEARCHED))
    document = {
        who: {
            "none_late_hz": one.in_time_hz,
            "none_lost_hz": one.complete_hz,
            "tried": {f"{rate_hz:g}": dataclasses.asdict(cycles) for rate_hz, cycles in one.tried.items()},
            "faults": {f"{rate_hz:g}": why for rate_hz, why in one.faults.items()},
        }
        for who, one in held.items()
    }
    return _Part({"hold_s": hold_s, "programs": document}, table.held_text(held, hold_s))


def _lock_step(_options: argparse.Namespace) -> _Part:
    measured = lock_step()
    document = [{**dataclasses.asdict(one), "times_real_time": one.times_real_time} for one in measured]
    return _Part(document, table.lock_step_text(measured))


def _campaign(_options: argparse.Namespace) -> _Part:
    speed = campaign_speed()
    return _Part({**dataclasses.asdict(speed), "runs_per_s": speed.runs_per_s}, table.campaign_text(speed))


def _latency(options: argparse.Namespace) -> _Part:
    """From a set-point that is published to the motor frame, with the default of robot files, and at once."""
    trials = _FULL_TRIALS if options.full else _TRIALS
    wheres = [Where.SAME_PROCESS]
    if not missing_packages():
        wheres.append(Where.OTHER_PROCESS)
        lack = other_host_lacks()
        if lack is None:
            wheres.append(Where.OTHER_HOST)
        else:
            _report(f"no set-points from another host: {lack}")
    measured, text = [], "set-point to motor frame:"
    with held_conditions():
        for actuate, where in itertools.product(_ACTUATE, wheres):
            if where is Where.OTHER_HOST:
                with other_host() as (prefix, environment):
                    one = measure(where, trials=trials, actuate=actuate, publisher=prefix, environment=environment)
            else:
                one = measure(where, trials=trials, actuate=actuate)
            measured.append(one)
            text += f"\n{one.text()}"
            # Of another host nothing is required: the network is part of that.
            if actuate == _AT_ONCE and where is not Where.OTHER_HOST:
                text += f"; at most {one.limit_s * 1e3:g} ms wanted: {'met' if one.is_within else 'NOT met'}"
    return _Part(msgspec.to_builtins(measured), text)


def _model(_options: argparse.Namespace) -> _Part:
    if missing_compiler() is not None:
        return _Part(None, f"native model: {missing_compiler()}")
    cost = model_step()
    return _Part(cost, table.model_text(cost))


def _links(_options: argparse.Namespace) -> _Part:
    """A cycle over the kernel's CAN: here where it has a virtual interface, else in a kernel that has one."""
    cost = links_cost()
    if cost is None and uml.available() is None:
        measure = [sys.executable, "-P", "-m", "segway_ecc.hil.bench.speed"]
        output = uml.run_in_guest(measure, cwd=Path.cwd(), interfaces=("vcan0",)).output
        cost = msgspec.json.decode(output, type=dict[str, float] | None)
    if cost is None:
        remedy = "sudo apt-get install user-mode-linux"
        return _Part(None, f"CAN links: no SocketCAN here, and no user-mode Linux ({remedy})")
    return _Part(cost, table.links_text(cost))


_PARTS: Final[dict[str, Callable[[argparse.Namespace], _Part]]] = {
    "loops": _loops,
    "held": _held,
    "lock-step": _lock_step,
    "campaign": _campaign,
    "latency": _latency,
    "model": _model,
    "links": _links,
}
