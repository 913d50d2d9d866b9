import pytest

from segway_ecc.firmware_io.drives.off_word import OffWord


@pytest.fixture
def word() -> OffWord:
    return OffWord()


def test_nothing_is_said_at_first(word: OffWord) -> None:
    assert not word.says_off


@pytest.mark.parametrize("is_off", [True, False])
def test_the_newest_counts(word: OffWord, *, is_off: bool) -> None:
    word.hear(1, is_off=not is_off)
    word.hear(2, is_off=is_off)
    assert word.says_off is is_off


def test_what_was_said_before_it_was_told_to_switch_off_does_not_count(word: OffWord) -> None:
    word.hear(5, is_off=True)
    word.told(10)
    assert not word.says_off


@pytest.mark.parametrize(("received_ns", "counts"), [(9, False), (10, False), (11, True)])
def test_nor_does_what_had_arrived_by_then_and_is_looked_at_later(
    word: OffWord, received_ns: int, *, counts: bool
) -> None:
    word.told(10)
    word.hear(received_ns, is_off=True)
    assert word.says_off is counts
