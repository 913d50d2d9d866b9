# SPDX-License-Identifier: MIT
"""`segway-ecc prove soak`: what it prints, writes and refuses, on scripted runs."""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.soak import real_time, simulated
from segway_ecc.hil.soak.watching import Series, Watching
from segway_ecc.hil.verbs import prove_soak
from segway_ecc.node.errors import ConfigurationError

RealTimeSoak = Callable[..., Any]
ARMED = {"DISARMED: just started": 3, "ARMED: it armed itself": 900}


def options(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    prove_soak.add_arguments(parser)
    return parser.parse_args(words)


def fill(watching: Watching, slope: float) -> None:
    times = [10.0 * i for i in range(100)]
    values = [1000.0 + slope * i for i in range(100)]
    watching.series.append(
        Series(process="node", quantity="memory", unit="kB", allowed=512.0, times_s=times, values=values)
    )


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the runs find, and what they were asked."""
    script: dict[str, Any] = {"slope": 0.0, "trip": "", "modes": ARMED, "asked": []}

    def lock_step(job: simulated.SimulatedSoak, watching: Watching, on_progress: Any) -> simulated.ProcessSample:
        script["asked"].append((job.robot, job.duration_s))
        fill(watching, script["slope"])
        on_progress(job.duration_s)
        return simulated.ProcessSample(job.duration_s, trip=script["trip"], cycles=720, is_over=True)

    def in_real_time(run: real_time.RealTimeSoak, watching: Watching, on_progress: Any) -> real_time.RealTimeResult:
        script["asked"].append((run.robot, run.duration_s, run.ros))
        fill(watching, 0.0)
        on_progress(run.duration_s)
        node = {"cycles": 360, "late": 4, "overrun": 0, "skipped": 1, "mean_rate_hz": 200.0}
        return real_time.RealTimeResult(node, script["modes"])

    monkeypatch.setattr(simulated, "soak", lock_step)
    monkeypatch.setattr(real_time, "soak", in_real_time)
    monkeypatch.setattr(prove_soak, "missing_packages", lambda: ())
    return script


def test_four_hours_and_half_an_hour_are_what_is_run(
    scripted: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert prove_soak.run(options()) == 0
    assert scripted["asked"] == [("segway", 14_400.0), ("segway", 1800.0, True)]
    out = capsys.readouterr().out
    assert "simulated: 240 min, 720 cycles; no fault" in out
    assert "real time: 30 min, 360 cycles, 4 late, 1 skipped; no fault" in out
    assert "GROWS" not in out


def test_growth_is_exit_code_1_and_reported(scripted: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    scripted["slope"] = 10.0
    assert prove_soak.run(options("--real-time", "0")) == 1
    assert scripted["asked"] == [("segway", 14_400.0)]
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "memory" in line]
    assert row.split() == ["node", "memory,", "kB", "1295", "1895", "1990", "790", "512", "GROWS"]


@pytest.mark.parametrize(
    ("trip", "modes", "code"),
    [
        ("FAULT at 7.500 s: left.angle is too old", ARMED, 1),
        ("", {"ARMED: x": 899, "FAULT: y": 101}, 1),
        ("", {"ARMED: x": 950, "FAULT: y": 10, "DISARMED: z": 40}, 0),
        ("", {}, 1),
    ],
)
def test_a_robot_that_does_not_drive_proves_nothing(
    scripted: dict[str, Any], trip: str, modes: dict[str, int], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted["trip"], scripted["modes"] = trip, modes
    assert prove_soak.run(options("--json")) == code
    document = json.loads(capsys.readouterr().out)
    assert document["simulated"]["failure"] == trip
    assert document["real_time"]["modes"] == modes
    assert document["real_time"]["verdicts"][0]["is_growing"] is False


@pytest.mark.usefixtures("scripted")
def test_the_report_has_every_sample_and_a_figure_of_each_part(tmp_path: Path) -> None:
    assert prove_soak.run(options("--out", str(tmp_path / "new"))) == 0
    written = {path.name for path in (tmp_path / "new").glob("soak*")}
    assert written == {"soak.json", "soak-simulated.svg", "soak-real-time.svg"}
    document = json.loads((tmp_path / "new" / "soak.json").read_bytes())
    assert len(document["series"]["simulated"][0]["values"]) == 100
    assert b"<svg" in (tmp_path / "new" / "soak-simulated.svg").read_bytes()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--simulated", "0.01"), "--simulated must be 0, or 600 s at least"),
        (("--simulated", "nan"), "--simulated must be 0, or"),
        (("--real-time", "0.5"), "--real-time must be 0, or 120 s at least"),
        (("--real-time", "-1"), "--real-time must be 0, or"),
        (("--simulated", "0", "--real-time", "0"), "leave nothing to run"),
        (("--out", "/proc/nowhere"), "cannot write to /proc/nowhere"),
    ],
)
@pytest.mark.usefixtures("scripted")
def test_nonsense_is_refused(words: tuple[str, ...], text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        prove_soak.run(options(*words))
