# SPDX-License-Identifier: MIT
"""What the two ways to the kernel's CAN cost in a cycle: `python -P -m segway_ecc.hil.verbs.bench_links`."""

import argparse
import contextlib
import statistics
import sys
import time
from typing import Final

from segway_ecc.firmware_io.links.can_ports import make_can_link, make_python_can_link
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.bench.rig import virtual_interface
from segway_ecc.node.cli.options import add_json, print_json

_CYCLES: Final = 500
_WARM_UP: Final = 20
_IN: Final = [Frame(0x120 + number, bytes(range(8))) for number in range(4)]
_OUT: Final = [Frame(0x110 + number, bytes(range(8))) for number in range(2)]
_BITRATE: Final = 500_000
_EXIT_MISSING: Final = 4


def links_cost() -> dict[str, float] | None:
    """Time a cycle of four frames in and two out through python-can and through a raw socket, in turns.

    Only on a virtual interface: what is sent here would reach the motors of a real one.

    Returns:
        The median of each, us, and how many times the raw socket is faster; None where there is no virtual interface
        that is up.
    """
    channel = virtual_interface()
    if channel is None:
        return None
    with (
        contextlib.closing(make_can_link("socketcan", channel, _BITRATE)) as feeder,
        contextlib.closing(make_python_can_link("socketcan", channel, _BITRATE)) as python_can,
        contextlib.closing(make_can_link("socketcan", channel, _BITRATE)) as raw,
    ):
        for each in (feeder, python_can, raw):
            each.open()
        links: dict[str, Link] = {"python_can_us": python_can, "raw_us": raw}
        costs: dict[str, list[float]] = {name: [] for name in links}
        for cycle in range(_WARM_UP + _CYCLES):
            for name, link in links.items():
                cost_us = _cycle_us(link, feeder, [other for other in links.values() if other is not link])
                if cycle >= _WARM_UP:
                    costs[name].append(cost_us)
    medians = {name: statistics.median(values) for name, values in costs.items()}
    return {**medians, "ratio": medians["python_can_us"] / medians["raw_us"]}


def main(arguments: list[str] | None = None) -> int:
    """Measure and print one line."""
    parser = argparse.ArgumentParser(prog="python -P -m segway_ecc.hil.verbs.bench_links", description=__doc__)
    add_json(parser)
    options = parser.parse_args(arguments)
    cost = links_cost()
    if options.json:
        print_json(cost)
    elif cost is None:
        sys.stderr.write("no virtual CAN interface is up: sudo ip link add dev vcan0 type vcan; ip link set vcan0 up\n")
    else:
        sys.stdout.write(links_text(cost) + "\n")
    return _EXIT_MISSING if cost is None else 0


def links_text(cost: dict[str, float]) -> str:
    """What `links_cost` found, in one line."""
    return (
        f"CAN links: 4 frames in and 2 out in a cycle cost {cost['python_can_us']:.0f} us through python-can, "
        f"{cost['raw_us']:.0f} us through a raw socket, {cost['ratio']:.1f} times faster (medians, on vcan)"
    )


def _cycle_us(link: Link, feeder: Link, others: list[Link]) -> float:
    """One cycle of `link`; the other participants take no time from it."""
    for frame in _IN:
        feeder.send(frame)
    start_ns = time.perf_counter_ns()
    received = link.receive()
    for frame in _OUT:
        link.send(frame)
    end_ns = time.perf_counter_ns()
    if len(received) < len(_IN):
        raise RuntimeError(f"{len(received)} of {len(_IN)} frames arrived on {link.description}")
    for other in (feeder, *others):
        other.receive()
    return (end_ns - start_ns) / 1e3


if __name__ == "__main__":
    sys.exit(main())
