# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.trajectory import MOST_POINTS, TimedSetpoint
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.sequence.manoeuvre import (
    Manoeuvre,
    Segment,
    load_manoeuvre,
    points,
    schedule,
    single_segment,
)

MS = 1_000_000
AHEAD, TURN = Setpoint(1.0, 0.0), Setpoint(1.0, -0.5)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "sequence.yaml"


def refusal(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_manoeuvre(str(path))
    message = str(caught.value)
    assert message.startswith(f"{path}")
    assert "\n" not in message
    return message.removeprefix(f"{path}")


def test_every_set_point_is_sent_at_its_start_and_renewed_and_rest_at_the_end() -> None:
    manoeuvre = Manoeuvre(
        segments=(Segment(linear=1.0, duration=0.25), Segment(linear=1.0, angular=-0.5, duration=0.1))
    )
    assert list(schedule(manoeuvre)) == [
        TimedSetpoint(0, AHEAD),
        TimedSetpoint(100 * MS, AHEAD),
        TimedSetpoint(200 * MS, AHEAD),
        TimedSetpoint(250 * MS, TURN),
        TimedSetpoint(350 * MS, REST),
    ]
    assert manoeuvre.duration_ns == 350 * MS


def test_what_ends_on_a_renewal_is_not_renewed_there() -> None:
    assert [timed.offset_ns for timed in schedule(single_segment(1.0, 0.0, 0.2))] == [0, 100 * MS, 200 * MS]


def test_segments_add_up_without_rounding() -> None:
    # A third of a second is rounded to the nanosecond once per segment, and every start is the sum of those.
    manoeuvre = Manoeuvre(segments=(Segment(duration=1.0 / 3.0),) * 3)
    assert manoeuvre.duration_ns == 3 * 333_333_333
    assert list(schedule(manoeuvre))[-1].offset_ns == manoeuvre.duration_ns


def test_a_file_is_read_with_what_it_leaves_out_at_zero(path: Path) -> None:
    path.write_text("segments:\n  - {linear: 1, duration: 10}\n  - {angular: -0.5, duration: 0.5}\n", encoding="utf-8")
    assert load_manoeuvre(str(path)) == Manoeuvre(
        segments=(Segment(linear=1.0, angular=0.0, duration=10.0), Segment(linear=0.0, angular=-0.5, duration=0.5))
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("segments: []", ": Expected `array` of length >= 1 at segments; found []"),
        ("segment: []", ": Object contains unknown field `segment`; the keys there are segments"),
        ("segments: [{linear: 1}]", ": Object missing required field `duration` at segments.0"),
        ("segments: [{duration: 0}]", ": Expected `float` > 0.0 at segments.0.duration; found 0"),
        (
            "segments: [{duration: 1}, {duration: 86401}]",
            ": Expected `float` <= 86400.0 at segments.1.duration; found 86401",
        ),
        ("segments: [{duration: fast}]", ": Expected `float`, got `str` at segments.0.duration; found 'fast'"),
        ("segments: [{duration: 1, linear: .inf}]", ": linear of segment 0 is inf; it must be finite"),
        ("segments: [{duration: 1}, {duration: 1, angular: .nan}]", ": angular of segment 1 is nan; it must be finite"),
    ],
)
def test_a_file_that_is_not_as_it_must_be_is_refused_with_the_place(path: Path, text: str, message: str) -> None:
    assert refusal(path, text) == message


def test_an_unknown_key_of_a_segment_is_refused_with_those_there_are(path: Path) -> None:
    message = refusal(path, "segments: [{duration: 1, speed: 2}]")
    assert message == (
        ": Object contains unknown field `speed` at segments.0; the keys there are angular, duration, linear"
    )


def test_what_is_not_yaml_is_refused(path: Path) -> None:
    assert refusal(path, "segments: [").startswith(" is not YAML: while parsing a flow node")


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^cannot read sequence file 'gone\.yaml': No such file or directory$"
    ):
        load_manoeuvre("gone.yaml")


def test_a_file_that_is_not_text_is_refused(path: Path) -> None:
    path.write_bytes(b"segments: \xff\xfe")
    with pytest.raises(ConfigurationError, match=r"^cannot read sequence file '.*': not UTF-8 text$"):
        load_manoeuvre(str(path))


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_single_segment_needs_a_duration(duration: float) -> None:
    with pytest.raises(ConfigurationError, match=f"more than 0 s and at most 86400 s, not {duration}$"):
        single_segment(1.0, 0.0, duration)


@pytest.mark.parametrize(
    ("linear", "angular", "duration", "name"),
    [(float("nan"), 0.0, 1.0, "linear"), (0.0, float("inf"), 1.0, "angular")],
)
def test_a_single_segment_must_be_finite(linear: float, angular: float, duration: float, name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^sequence: {name} of segment 0 is (nan|inf); it must be finite$"):
        single_segment(linear, angular, duration)


def test_no_segment_is_shorter_than_a_nanosecond() -> None:
    assert single_segment(1.0, 0.0, 1e-12).duration_ns == 1


def test_a_file_of_more_segments_than_a_trajectory_has_points_is_refused(path: Path) -> None:
    most = "segments:\n" + "  - {duration: 1}\n" * (MOST_POINTS - 1)
    path.write_text(most, "utf-8")
    assert len(points(load_manoeuvre(str(path)))) == MOST_POINTS
    assert "length <= 999" in refusal(path, most + "  - {duration: 1}\n")
