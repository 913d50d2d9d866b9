# SPDX-License-Identifier: MIT
"""The state of generated code: given as words of its memory, and put back in another instance of it."""

import struct
from pathlib import Path

import msgspec
import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.native.load import load_native
from tests.fixtures.noisy import DRAWS, noisy
from tests.fixtures.twenty_sim.maker import Maker

SHAPES = pytest.mark.parametrize("shape", ["submodel", "cpp_class", "partial"])
WORD = struct.Struct("<QQ")
ADDRESS = 1 << 63


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "compiled"))


def drive(model: NativeModel, steps: int) -> list[str]:
    return [model.step([0.5])[0].hex() for _ in range(steps)]


def started(path: Path, steps: int = 0) -> NativeModel:
    model = load_native(path)
    model.initialize([0.25])
    drive(model, steps)
    return model


def changed(state: bytes, words: list[tuple[int, int]]) -> bytes:
    """The state with other words."""
    held = msgspec.msgpack.decode(state)
    (memory,) = (name for name in held if name.startswith("memory"))
    return msgspec.msgpack.encode({**held, memory: b"".join(WORD.pack(*word) for word in words)})


def words_of(state: bytes) -> list[tuple[int, int]]:
    (memory,) = (held for held in msgspec.msgpack.decode(state).values() if isinstance(held, bytes))
    return list(WORD.iter_unpack(memory))


@pytest.mark.variants(1)
@SHAPES
def test_another_instance_goes_on_from_it_random_numbers_included(make: Maker, tmp_path: Path, shape: str) -> None:
    path = noisy(make, tmp_path, shape, DRAWS)
    model = started(path, 7)
    state = model.save_state()
    assert model.save_state() == state
    rest = drive(model, 8)
    fresh, used = load_native(path), started(path, 3)
    for other in (fresh, used, model):
        other.restore_state(state)
        assert other.save_state() == state
        assert drive(other, 8) == rest
        assert other.save_state() != state


@pytest.mark.variants(1)
@SHAPES
def test_it_can_be_initialized_again_behind_it(make: Maker, tmp_path: Path, shape: str) -> None:
    path = noisy(make, tmp_path, shape, DRAWS)
    first = drive(started(path), 8)
    model = load_native(path)
    model.restore_state(started(path, 5).save_state())
    model.initialize([0.25])

    assert drive(model, 8) == first


def test_memory_that_is_not_its_own_is_refused(make: Maker, tmp_path: Path) -> None:
    body = "static double *kept; if (!kept) kept = (double *) malloc(8), *kept = 0.0; return *kept += 1.0;"
    path = noisy(make, tmp_path, "submodel", body)

    with pytest.raises(ModelError, match="give its state: it holds the address of memory that is not its own"):
        started(path, 2).save_state()


def test_memory_whose_address_is_kept_in_another_form_is_not_in_it(make: Maker, tmp_path: Path) -> None:
    """A limit that the flight recorder's page names."""
    body = "static size_t other; if (!other) other = ~(size_t) calloc(1, 8); return *(double *) ~other += 1.0;"
    model = started(noisy(make, tmp_path, "submodel", body), 3)
    state = model.save_state()
    counted = drive(model, 1)
    model.restore_state(state)

    assert drive(model, 1) != counted


def test_what_is_too_large_is_refused(make: Maker, tmp_path: Path) -> None:
    body = "static double line[4000]; int i; for (i = 0; i < 4000; i++) line[i] += 1.0 + i; return line[7];"
    path = noisy(make, tmp_path, "submodel", body)

    with pytest.raises(ModelError, match="give its state: it is too large"):
        started(path, 2).save_state()


def test_an_fmu_does_not_give_it(make: Maker, tmp_path: Path) -> None:
    model = started(noisy(make, tmp_path, "fmu", "return 0.0;"))
    with pytest.raises(ModelError, match=r"an FMI 3\.0 co-simulation does not give it"):
        model.save_state()
    with pytest.raises(ModelError, match="compiled otherwise"):
        model.restore_state(msgspec.msgpack.encode({}))


def test_places_and_addresses_are_checked_and_nothing_is_written_before(make: Maker, tmp_path: Path) -> None:
    path = noisy(make, tmp_path, "submodel", DRAWS)
    model = started(path, 4)
    state = model.save_state()
    words = words_of(state)
    model.step([0.5])
    now = model.save_state()
    mapped = int(Path("/proc/self/maps").read_text(encoding="ascii").split("-")[0], 16)
    for bad in (
        [*words, (1 << 40, 0)],
        [*words, (words[-1][0] + 1_000_000, 0)],
        words[::-1],
        [*words, words[-1]],
        [(ADDRESS | words[0][0] & ~ADDRESS, 1 << 40), *words[1:]],
        [(words[0][0] & ~ADDRESS, mapped), *words[1:]],
    ):
        with pytest.raises(ModelError, match="take its state back"):
            model.restore_state(changed(state, bad))
        assert model.save_state() == now
    with pytest.raises(ModelError, match="compiled otherwise"):
        started(noisy(make, tmp_path / "other", "submodel", "return 1.0;")).restore_state(state)
    model.restore_state(state)
    assert model.save_state() == state
