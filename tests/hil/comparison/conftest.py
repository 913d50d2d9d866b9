# SPDX-License-Identifier: MIT
"""Recorded drives of simulated robots, whose plant may differ from the one that their robot file names."""

import contextlib
import functools
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.hil.design.balance import Balance, ScriptedStage
from segway_ecc.node.config import load_robot
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of

DriveRecord = Callable[..., Path]


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> DriveRecord:
    """Called with what differs in the plant of `segway`, and for how long; returns the log of how it drives."""

    @functools.cache
    def record(*differs: tuple[str, float], seconds: float = 4.0) -> Path:
        path, file = tmp_path_factory.mktemp("drive") / "run.mcap", load_robot("segway")
        balance = Balance(file, pitch=0.5, plant=dict(differs))
        log = CycleLog(path, layout_of(balance.robot), provenance_of(file))
        period_ns = balance.robot.period_ns
        balance.world = ScriptedStage({2.0: functools.partial(balance.drive, 0.4, 0.4)}, period_ns)
        with contextlib.closing(log), contextlib.closing(balance._end):
            balance.robot.loop(balance.world, log).run(round(seconds * 1e9 / period_ns))
        return path

    return record
