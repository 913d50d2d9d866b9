# SPDX-License-Identifier: MIT
"""Sequence control at the far end of a real network: netem between namespaces, in a kernel that has it."""

import json
import statistics
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from segway_ecc.hil.kernels.guest import to_stdout
from segway_ecc.hil.kernels.qemu import run_in_guest

pytestmark = [pytest.mark.proof, pytest.mark.rt_kernel, pytest.mark.ros]

ROOT = Path(__file__).parents[2]
POINTS = Path(__file__).with_name("netem_points.py")
PERIOD_MS = 10.0
"""Of the cart's loop."""
ENDS_WITHIN_S = 800.0


class Point(NamedTuple):
    """What came of the set-points at one point.

    Attributes:
        late_ms: How long after it was said, or after the time it was for, each came into force that did.
        missing: How many never did: lost, too old, or overtaken by a newer one within a cycle.
    """

    stamped: bool
    latency_ms: int
    loss: int
    cut: bool
    late_ms: list[float]
    missing: int


def point(told: dict[str, Any]) -> Point:
    came = [
        (applied - (said if for_ns is None else for_ns)) * 1e-6
        for said, for_ns, applied in told["said"]
        if applied is not None
    ]
    missing = len(told["said"]) - len(came)
    return Point(told["stamped"], told["latency_ms"], told["loss"], told["cut"], came, missing)


def row(found: Point) -> str:
    topic = "cmd_vel_stamped" if found.stamped else "cmd_vel"
    network = f"{found.latency_ms:4d} ms {found.loss:2d} %{' partition of 2 s' if found.cut else ''}"
    late = sorted(found.late_ms)
    return f"{topic:<16} {network:<32} {statistics.median(late):8.1f} {late[-1]:8.1f} {found.missing:8d}\n"


def refusals(diagnostics: dict[str, dict[str, str]]) -> dict[str, str]:
    return {name: text for values in diagnostics.values() for name, text in values.items() if "refused" in name}


def test_stamps_hide_what_the_network_does_and_nothing_else_does(tmp_path: Path) -> None:
    """Printed, since it depends on the machine; what is asserted holds on any."""
    results = tmp_path / "results"
    file = results / "points.json"
    environment = {"PYTHONPATH": str(ROOT)}
    outcome = run_in_guest(
        [sys.executable, str(POINTS), str(file)],
        cwd=ROOT,
        environment=environment,
        timeout_s=ENDS_WITHIN_S,
        on_output=to_stdout,
        results=results,
    )
    assert outcome.exit_status == 0, outcome.output
    document = json.loads(file.read_text(encoding="utf-8"))
    points = [point(told) for told in document["points"]]
    table = "".join(map(row, points))
    sys.stderr.write(f"set-points on    network                    late, ms: median      max  missing\n{table}")
    sys.stderr.write(f"the robot refused {refusals(document['told']['diagnostics'])}\n")

    plain = {p.latency_ms: p for p in points if not p.stamped and not p.loss and not p.cut}
    for latency_ms, found in plain.items():
        # The stamp of a cycle is its deadline, which may lie up to a period before a message was said.
        assert min(found.late_ms) >= latency_ms - PERIOD_MS
    assert [statistics.median(plain[ms].late_ms) for ms in (0, 50, 200)] == sorted(
        statistics.median(plain[ms].late_ms) for ms in (0, 50, 200)
    )
    for found in (p for p in points if p.stamped and not p.loss and not p.cut):
        assert max(map(abs, found.late_ms)) <= 0.5 * PERIOD_MS, "stamped ahead, each is in force in its own cycle"
        assert len(found.late_ms) > found.missing
    cuts = [p for p in points if p.cut]
    assert all(p.missing > 0 for p in cuts), "half a second ahead is less than two seconds"
    assert "HOLD: no set-point arrives any more" in document["robot"]
