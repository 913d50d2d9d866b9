# SPDX-License-Identifier: MIT
"""The command line of the bench, with measurements that are made up; tests/hil/bench tests what is measured."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from segway_ecc.hil.bench.comparison import ComparisonSetup, ProgramResult
from segway_ecc.hil.bench.contestants import Contestant
from segway_ecc.hil.bench.rig import Conditions
from segway_ecc.hil.bench.samples import Cycles, Spread
from segway_ecc.hil.latency.measure import Latency, OtherHost, Where
from segway_ecc.hil.process_usage import Memory
from segway_ecc.hil.verbs import bench
from segway_ecc.node.errors import ConfigurationError

Run = Callable[..., Any]
COSTS_US = {Contestant.OURS: 50.0, Contestant.USER: 500.0, Contestant.C: 10.0, Contestant.BARE: 5.0}


def made_up(cost_us: float) -> ProgramResult:
    spread = Spread(*[cost_us * 1e-6] * 5)
    cycles = Cycles(5000, 0, 0, spread, Spread(*[40e-6] * 5), {})
    return ProgramResult(cycles, 0.03, Memory(2_000_000, 1_000_000), 0.2)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float, int]]:
    """Rate, length and repeats of each comparison that was asked for."""
    made: list[tuple[float, float, int]] = []

    def compare(
        _: ComparisonSetup, rate_hz: float, duration_s: float, repeats: int, who: list[Contestant]
    ) -> dict[Contestant, ProgramResult]:
        made.append((rate_hz, duration_s, repeats))
        return {one: made_up(COSTS_US[one]) for one in who}

    @contextmanager
    def conditions(*, is_subscribed: bool = False) -> Iterator[Conditions]:
        yield Conditions(
            priority=50,
            idle_states_off=True,
            memory_locked=False,
            cores=2,
            isolated=(),
            kernel="6.1 PREEMPT_RT",
            is_subscribed=is_subscribed,
        )

    monkeypatch.setattr(bench, "compare", compare)
    monkeypatch.setattr(bench, "held_conditions", conditions)
    monkeypatch.setattr(bench, "missing_compiler", lambda: None)
    monkeypatch.setattr(bench, "missing_packages", list)
    return made


def test_the_loops_are_compared_at_each_rate_and_judged(segway_ecc: Run, asked: list[tuple[float, float, int]]) -> None:
    outcome = segway_ecc("bench", "--only", "loops", "--rate", "100", "500", "--duration", "2", "--repeats", "3")
    assert outcome.code == 0
    assert asked == [(100.0, 2.0, 3), (500.0, 2.0, 3)]
    assert "SCHED_FIFO 50, idle states off" in outcome.out
    assert "6.1 PREEMPT_RT, without subscribers; the same for all programs" in outcome.out
    assert outcome.out.count("ours to the user's loop: 0.10, at most 0.25 wanted: met") == 2


@pytest.mark.usefixtures("asked")
def test_a_claim_that_is_not_met_is_printed_and_is_a_failure_only_where_that_is_asked_for(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("bench", "--only", "loops", "--rate", "100")
    assert segway_ecc(*words, "--check").code == 0
    monkeypatch.setitem(COSTS_US, Contestant.C, 1.0)
    outcome = segway_ecc(*words)
    assert outcome.code == 0
    assert "ours to the loop in C: 50.00, at most 6 wanted: NOT met" in outcome.out
    assert segway_ecc(*words, "--check").code == 1


@pytest.mark.usefixtures("asked")
def test_somebody_subscribes_where_that_is_asked_for_and_ros_is_there(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("bench", "--only", "loops", "--rate", "100", "--subscribed")
    assert "with a subscriber; the same for all programs" in segway_ecc(*words).out
    monkeypatch.setattr(bench, "missing_packages", lambda: ["rclpy"])
    outcome = segway_ecc(*words)
    assert outcome.code == 2
    assert outcome.errors == ["segway-ecc: --subscribed needs ROS 2: rclpy is not there"]


@pytest.mark.usefixtures("asked")
def test_json_has_the_figures_and_the_claims(segway_ecc: Run) -> None:
    found = json.loads(segway_ecc("bench", "--only", "loops", "--rate", "100", "--json").out)["loops"]
    assert found["conditions"]["priority"] == 50
    at = found["rates"][0]
    assert at["rate_hz"] == 100.0
    assert at["programs"]["ours"]["cycles"]["cost"]["p99_s"] == pytest.approx(50e-6)
    assert at["programs"]["c"]["memory"] == {"rss": 2_000_000, "pss": 1_000_000}
    assert [claim["met"] for claim in at["claims"]] == [True, True, True]


@pytest.mark.usefixtures("asked")
def test_programs_are_left_out_where_others_are_named(segway_ecc: Run) -> None:
    outcome = segway_ecc("bench", "--only", "loops", "--rate", "100", "--programs", "bare", "c", "--json")
    assert list(json.loads(outcome.out)["loops"]["rates"][0]["programs"]) == ["c", "bare"]


def test_a_full_run_is_long(segway_ecc: Run, asked: list[tuple[float, float, int]]) -> None:
    segway_ecc("bench", "--only", "loops", "--full")
    assert asked == [(100.0, 10.0, 4), (1000.0, 10.0, 4)]


@pytest.mark.usefixtures("asked")
def test_without_ros_the_users_loop_is_left_out_and_that_is_reported(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "missing_packages", lambda: ["rclpy"])
    outcome = segway_ecc("bench", "--only", "loops", "--rate", "100")
    assert "user's loop" not in outcome.out
    assert any("no ROS 2 here (rclpy)" in line for line in outcome.errors)


@pytest.mark.usefixtures("asked")
@pytest.mark.parametrize(("p99_s", "word"), [(0.0109, "met"), (0.0111, "NOT met")])
def test_a_set_point_is_followed_to_the_motor_frame(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, p99_s: float, word: str
) -> None:
    @contextmanager
    def host() -> Iterator[OtherHost]:
        yield OtherHost(["there"], {"NAME": "value"})

    def measure(
        where: Where, *, trials: int, actuate: str, publisher: Sequence[str] = (), environment: object = None
    ) -> Latency:
        assert (publisher, environment) == ((["there"], {"NAME": "value"}) if where is Where.OTHER_HOST else ((), None))
        return Latency(
            where=where, actuate=actuate, period_s=0.01, trials=trials, missed=0, p50_s=0.005, p99_s=p99_s, max_s=0.02
        )

    monkeypatch.setattr(bench, "measure", measure)
    monkeypatch.setattr(bench, "other_host", host)
    monkeypatch.setattr(bench, "other_host_lacks", lambda: None)
    lines = segway_ecc("bench", "--only", "latency").out.splitlines()[1:]
    begins = [f"{where}, actuate {how}" for how in ("immediately", "next_cycle") for where in Where]
    assert [line.partition(":")[0] for line in lines] == begins
    assert [line.endswith(f"; at most 11 ms wanted: {word}") for line in lines] == [True, True, *[False] * 4]
    found = json.loads(segway_ecc("bench", "--only", "latency", "--full", "--json").out)["latency"]
    assert [one["trials"] for one in found] == [1000] * 6
    monkeypatch.setattr(bench, "other_host_lacks", lambda: "no ip command")
    outcome = segway_ecc("bench", "--only", "latency")
    assert "other host" not in outcome.out
    assert "segway-ecc: no set-points from another host: no ip command" in outcome.errors
    monkeypatch.setattr(bench, "missing_packages", lambda: ["rclpy"])
    assert "other process" not in segway_ecc("bench", "--only", "latency").out


@pytest.mark.parametrize("part", ["loops", "held", "model"])
def test_without_a_compiler_the_remedy_is_reported(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, part: str) -> None:
    monkeypatch.setattr(bench, "missing_compiler", lambda: "there is no C compiler here")
    outcome = segway_ecc("bench", "--only", part)
    assert outcome.code == 0
    assert "there is no C compiler here" in outcome.out


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--rate", "0"), "--rate must be 1 to 100000 Hz, not 0"),
        (("--rate", "100", "0"), "--rate must be 1 to 100000 Hz, not 0"),
        (("--duration", "0.5"), "--duration must be at least 1 s, not 0.5"),
        (("--hold", "0.5"), "--hold must be at least 1 s, not 0.5"),
        (("--repeats", "0"), "--repeats must be at least 1, not 0"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(segway_ecc: Run, words: tuple[str, ...], why: str) -> None:
    outcome = segway_ecc("bench", *words)
    assert outcome.code == ConfigurationError.exit_code
    assert outcome.errors == [f"segway-ecc: {why}"]


def test_an_unknown_part_is_refused(segway_ecc: Run) -> None:
    assert segway_ecc("bench", "--only", "speed").code == 2
