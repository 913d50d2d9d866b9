# SPDX-License-Identifier: MIT
"""A log is given in pieces that lack nothing, and what is missing in it shows."""

from pathlib import Path

import msgspec
import pytest

from segway_ecc.deploy.station.playback import recorded_log
from segway_ecc.deploy.station.playback.recorded_log import MOST_ROWS, RecordedLog
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.mcap_log import McapLog
from segway_ecc.node.recording.salvage import Salvage
from segway_ecc.node.safety.modes import Mode
from tests.deploy.station.playback.log_maker import BEGIN_NS, LAYOUT, PERIOD_NS, STARTED_NS, record, story, write_log


def opened(path: Path) -> RecordedLog:
    return RecordedLog(Salvage(path))


@pytest.fixture
def log(tmp_path: Path) -> RecordedLog:
    return opened(write_log(tmp_path / "run.mcap", story()))


def test_log_as_a_whole_has_its_robot_its_time_and_its_limits(log: RecordedLog) -> None:
    view = log.view()
    assert (view.robot, view.begin_ns, view.period_s, view.cycles) == ("Alice", BEGIN_NS, 0.005, 2400)
    assert view.duration_s == pytest.approx(2399 * 0.005)
    assert (view.part, view.has_end, view.is_cut, view.damage, view.gaps) == (1, True, False, [], [])
    assert (view.is_balancing, view.tilt_limit_rad, view.down_rad) == (True, 0.8, 0.4)
    assert view.modes == [str(mode) for mode in Mode]


def test_events_are_modes_with_their_reasons_and_postures(log: RecordedLog) -> None:
    told = [(event.time_s, event.kind, event.name, event.text, event.level) for event in log.view().events]
    assert told == [
        (0.0, "mode", "DISARMED", "why it is DISARMED", "info"),
        (1.0, "posture", "STANDING UP", "", "info"),
        (1.0, "mode", "ARMED", "why it is ARMED", "info"),
        (1.5, "posture", "BALANCING", "", "info"),
        (9.0, "posture", "FALLEN", "the body leans 0.81 rad, beyond 0.8 rad", "error"),
        (9.0, "mode", "FAULT", "why it is FAULT", "error"),
    ]


def test_rows_hold_every_cycle_of_a_time_and_its_values(log: RecordedLog) -> None:
    rows = log.rows(2.0, 2.02, MOST_ROWS)
    assert (rows.per, rows.begin_ns, rows.cycle) == (1, BEGIN_NS, [400, 401, 402, 403, 404])
    assert rows.time_s == pytest.approx([2.0, 2.005, 2.01, 2.015, 2.02])
    expected = record(401)
    assert rows.pitch[1] == pytest.approx(expected.y[1], abs=1e-5)
    assert (rows.x[1], rows.y[1]) == pytest.approx(expected.published[:2], abs=1e-5)
    assert (rows.linear_velocity[1], rows.linear_setpoint[1], rows.heading[1]) == (0.5, 0.5, 0.0)
    assert (rows.mode[1], rows.is_off[1]) == (1, False)
    assert rows.supply_v == [None] * 5, "this robot does not measure it"


def test_pieces_one_behind_the_other_are_the_whole_log(log: RecordedLog) -> None:
    piece_s = log.view().piece_s
    assert 1.0 <= piece_s <= 10.0
    assert piece_s / log.view().period_s < MOST_ROWS
    found: list[int | None] = []
    for number in range(2):
        found += log.rows(number * piece_s, (number + 1) * piece_s - 1e-4, MOST_ROWS).cycle
    assert found == list(range(2400))


@pytest.mark.parametrize(("rate_hz", "piece_s"), [(100, 10.0), (200, 10.0), (1000, 2.0), (5000, 0.4)])
def test_piece_and_a_fifth_more_has_a_row_for_each_cycle(tmp_path: Path, rate_hz: int, piece_s: float) -> None:
    layout = msgspec.structs.replace(LAYOUT, period_ns=1_000_000_000 // rate_hz)
    cycles = round(2.5 * piece_s * rate_hz)
    records = [
        record(each, start_ns=STARTED_NS + each * layout.period_ns, stamp_ns=BEGIN_NS + each * layout.period_ns)
        for each in range(cycles)
    ]
    log = opened(write_log(tmp_path / "run.mcap", records, layout=layout))
    assert log.view().piece_s == pytest.approx(piece_s)
    rows = log.rows(0.8 * piece_s, 2.0 * piece_s, MOST_ROWS)
    assert rows.per == 1
    assert len(rows.cycle) == pytest.approx(1.2 * piece_s * rate_hz, abs=2)


def test_time_outside_of_the_log_has_no_rows(log: RecordedLog) -> None:
    assert log.rows(100.0, 200.0, MOST_ROWS).time_s == []


def test_cycles_that_are_missing_are_a_gap(tmp_path: Path) -> None:
    records = [each for each in story() if not 500 <= each.cycle < 600]
    log = opened(write_log(tmp_path / "run.mcap", records))
    assert log.view().gaps == [(2.495, 3.0)]
    rows = log.rows(2.49, 3.005, MOST_ROWS)
    assert rows.cycle == [498, 499, None, 600, 601]
    assert rows.time_s[2] == pytest.approx(2.7475), "in the middle of it"
    assert (rows.pitch[2], rows.mode[2], rows.is_off[2]) == (None, None, None)


def test_time_in_which_no_cycle_ran_is_a_gap(tmp_path: Path) -> None:
    late_ns = 400_000_000
    records = [
        record(each, start_ns=STARTED_NS + each * PERIOD_NS + (late_ns if each >= 150 else 0)) for each in range(300)
    ]
    assert opened(write_log(tmp_path / "run.mcap", records)).view().gaps == [(0.745, 1.15)]


@pytest.mark.parametrize("unpacked", [recorded_log._MOST_UNPACKED, 100], ids=["by cycles", "by chunks"])
def test_extremes_stand_for_many_cycles_so_that_no_peak_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unpacked: int
) -> None:
    monkeypatch.setattr(recorded_log, "_MOST_UNPACKED", unpacked)
    peaks = {777: 0.7, 1888: -0.6}
    records = [record(each, pitch=peaks.get(each, 0.01)) for each in range(2400) if not 1000 <= each < 1200]
    rows = opened(write_log(tmp_path / "run.mcap", records)).rows(0.0, 100.0, 20)
    assert rows.per > 1
    assert len(rows.time_s) <= 30
    known = [value for value in rows.pitch if value is not None]
    assert (max(known), min(known)) == (0.7, -0.6)
    assert rows.time_s == sorted(rows.time_s)
    gap = rows.pitch.index(None)
    assert rows.time_s[gap - 1] == pytest.approx(4.995)
    assert rows.time_s[gap + 1] == pytest.approx(6.0)
    assert set(rows.cycle) == {None}


def test_value_that_is_no_number_is_none(tmp_path: Path) -> None:
    records = [record(each, pitch=float("nan")) for each in range(10)]
    rows = opened(write_log(tmp_path / "run.mcap", records)).rows(0.0, 1.0, MOST_ROWS)
    assert rows.pitch == [None] * 10


def test_damage_and_a_missing_end_are_reported(tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap", story(), is_end=False)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    view = opened(path).view()
    assert not view.has_end
    assert len(view.damage) == 1
    assert "damaged" in view.damage[0]
    assert len(view.gaps) == 1


def test_cycles_that_come_twice_are_shown_once(tmp_path: Path) -> None:
    records = [record(each) for each in (*range(150), *range(100, 300))]
    rows = opened(write_log(tmp_path / "run.mcap", records)).rows(0.0, 10.0, MOST_ROWS)
    assert rows.cycle == list(range(300))


def test_later_file_of_a_run_has_its_number(tmp_path: Path) -> None:
    view = opened(write_log(tmp_path / "run.mcap", story()[500:700], part=3, is_end=False)).view()
    assert view.part == 3
    assert view.duration_s == pytest.approx(0.995)


def test_file_that_is_no_log_of_a_run_is_refused_with_its_name(tmp_path: Path) -> None:
    text = tmp_path / "notes.mcap"
    text.write_text("no log")
    with pytest.raises(RecordingError, match=r"notes\.mcap is no log of a run \(there is no layout\.json in it\)"):
        opened(text)
    with McapLog(tmp_path / "other.mcap") as log:
        log.float64("/a", BEGIN_NS, 1.0)
    with pytest.raises(RecordingError, match="no log of a run"):
        opened(tmp_path / "other.mcap")
    CycleLog(tmp_path / "empty.mcap", LAYOUT).close()
    with pytest.raises(RecordingError, match=r"empty\.mcap has no cycle"):
        opened(tmp_path / "empty.mcap")
