# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.station.web.limits import Bucket, Buckets, Rate, site_of

S = 1_000_000_000


def test_a_bucket_gives_its_burst_and_then_its_rate() -> None:
    bucket = Bucket(Rate(10.0, 5), 0)
    assert [bucket.take_token(0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert not bucket.take_token(S // 10 - 1_000_000)
    assert bucket.take_token(S // 10 + 1_000)
    assert not bucket.take_token(S // 10 + 2_000)


def test_in_the_long_run_it_gives_its_rate() -> None:
    bucket = Bucket(Rate(30.0, 30), 0)
    taken = sum(bucket.take_token(now_ns) for now_ns in range(0, 10 * S, S // 1000))
    assert taken == pytest.approx(30 + 30 * 10, abs=1)


def test_it_never_holds_more_than_its_burst() -> None:
    bucket = Bucket(Rate(10.0, 3), 0)
    assert sum(bucket.take_token(1000 * S) for _ in range(10)) == 3


def test_a_clock_that_goes_back_gives_nothing() -> None:
    bucket = Bucket(Rate(1.0, 1), 10 * S)
    assert bucket.take_token(10 * S)
    assert not bucket.take_token(0)
    assert not bucket.take_token(10 * S)


def test_looking_takes_nothing() -> None:
    bucket = Bucket(Rate(1.0, 1), 0)
    assert bucket.has_token(0)
    assert bucket.has_token(0)
    assert bucket.take_token(0)
    assert not bucket.has_token(0)


def test_each_key_has_a_bucket_of_its_own() -> None:
    buckets = Buckets(Rate(1.0, 1))
    assert buckets.of("a", 0).take_token(0)
    assert not buckets.of("a", 0).take_token(0)
    assert buckets.of("b", 0).take_token(0)


def test_keys_without_end_take_no_memory_without_end_and_the_silent_are_forgotten() -> None:
    buckets = Buckets(Rate(1.0, 1), most=10)
    for number in range(1000):
        assert buckets.of("busy", 0).take_token(0) == (number == 0)
        buckets.of(number, 0).take_token(0)
    assert len(buckets) == 10


@pytest.mark.parametrize(
    ("address", "site"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::9", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("nonsense", "nonsense"),
    ],
)
def test_what_counts_as_one_address(address: str, site: str) -> None:
    assert site_of(address) == site
