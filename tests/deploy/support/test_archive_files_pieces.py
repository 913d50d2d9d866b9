# SPDX-License-Identifier: MIT
"""What travels between a robot's archive and the station."""

import array
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.deploy.support.archive_files import (
    PIECE_BYTES,
    FileRequest,
    FinishedBundle,
    LogFile,
    file_request_of,
    finished_bundle_of,
    listing_of,
    logs_of,
    parameter_name,
    piece_of,
    words_of,
)

HASH = "0123456789abcdef" * 4


def test_a_piece_is_its_length_and_its_bytes_least_significant_first() -> None:
    assert list(words_of(b"\x01\x02\0\0\0\0\0\xff\x05")) == [
        9,
        *struct.unpack("<qq", b"\x01\x02\0\0\0\0\0\xff\x05" + bytes(7)),
    ]
    assert list(words_of(b"")) == [0]


@given(st.binary(max_size=100))
def test_a_piece_comes_as_it_went(piece: bytes) -> None:
    assert piece_of(words_of(piece)) == piece


@pytest.mark.parametrize(
    "words",
    [
        [],
        [1],
        [0, 0],
        [9, 0],
        [-1],
        [8, 0, 0],
        [PIECE_BYTES + 1, *[0] * (PIECE_BYTES // 8 + 1)],
        [2**63 - 1],
        [8, 2**63],
    ],
    ids=str,
)
def test_what_is_no_piece_is_none(words: list[int]) -> None:
    assert piece_of(words) is None


def test_a_full_piece_is_taken() -> None:
    piece = bytes(range(256)) * (PIECE_BYTES // 256)
    assert piece_of(words_of(piece)) == piece


@given(st.lists(st.integers(-(2**63), 2**63 - 1), max_size=6))
def test_no_words_make_it_fail(words: list[int]) -> None:
    piece = piece_of(array.array("q", words))
    assert piece is None or len(piece) == words[0]


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("log/a.mcap/0", FileRequest("log", "a.mcap", 0)),
        ("sha256/a b/12", FileRequest("sha256", "a b", 12)),
        ("bundle/x.zip/61440", FileRequest("bundle", "x.zip", 61440)),
    ],
)
def test_names_of_parameters(name: str, wanted: FileRequest) -> None:
    assert file_request_of(name) == wanted
    assert parameter_name(wanted) == name


@pytest.mark.parametrize(
    "name",
    [
        "",
        "logs",
        "use_sim_time",
        "log/a",
        "log//0",
        "log/a/-1",
        "log/a/+1",
        "log/a/1e3",
        "log/a/٣",
        "log/a/99999999999999999999",
        "log/a/9223372036854775807",
        "log/../secret/0",
        "log/a/b/0",
        "log/../0",
        "log/.a/0",
        "log/a\nb/0",
        "log/a\0/0",
        f"log/{'a' * 201}/0",
        "other/a/0",
    ],
)
def test_other_names_ask_for_nothing(name: str) -> None:
    assert file_request_of(name) is None


def test_a_listing_comes_as_it_went_and_what_cannot_be_asked_for_is_left_out() -> None:
    logs = [LogFile("a 1.mcap", 10, 5), LogFile("b", 0, 0)]
    assert listing_of([*logs, LogFile("c\nd", 1, 1), LogFile("\udc80", 1, 1)]) == ["a 1.mcap 10 5", "b 0 0"]
    assert logs_of(listing_of(logs)) == logs


@pytest.mark.parametrize("line", ["", "a", "a 1", "a 1 -1", "a x 1", " 1 1", "../a 1 1", ".a 1 1", "a/b 1 1", "a 1 1 "])
def test_lines_that_are_no_logs_are_left_out(line: str) -> None:
    assert logs_of([line, "ok 1 2"]) == [LogFile("ok", 1, 2)]


def test_a_listing_without_end_is_cut() -> None:
    assert len(logs_of(["a 1 1"] * 5000)) == 1000


def test_which_bundle_was_made() -> None:
    assert finished_bundle_of(f"a b.zip 12 {HASH}") == FinishedBundle("a b.zip", 12, HASH)
    for text in ("", "busy", "none", "failed: no room", f"a.zip 1 {HASH[1:]}", f"../a 1 {HASH}", f"a -1 {HASH}"):
        assert finished_bundle_of(text) is None
