# SPDX-License-Identifier: MIT
import multiprocessing
from multiprocessing.synchronize import Barrier
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import cached, digest, find_compiler, missing_compiler, run_compiler
from tests.patience import PATIENCE_S


def fill(draft: Path) -> None:
    (draft / "made").write_text("once")


def never(_draft: Path) -> None:
    raise AssertionError


def race(barrier: Barrier, seen: "multiprocessing.Queue[str]") -> None:
    def make(draft: Path) -> None:
        barrier.wait(timeout=PATIENCE_S)
        fill(draft)

    seen.put((cached("shared", make) / "made").read_text())


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "segway-ecc" / "models"


class TestDigest:
    def test_is_the_same_for_the_same_content(self) -> None:
        assert digest("a", b"b") == digest(b"a", "b")
        assert len(digest()) == 32

    @pytest.mark.parametrize("other", [("b", "a"), ("ab",), ("ab", ""), ("a",), ("a", "b", "")])
    def test_distinguishes_contents(self, other: tuple[str, ...]) -> None:
        assert digest("a", "b") != digest(*other)


class TestCached:
    def test_makes_an_entry_once(self, place: Path) -> None:
        assert cached("key", fill) == place / "key"
        assert cached("key", never) == place / "key"
        assert (place / "key" / "made").read_text() == "once"
        assert [entry.name for entry in place.iterdir()] == ["key"]

    def test_keeps_nothing_of_what_fails(self, place: Path) -> None:
        def fail(draft: Path) -> None:
            fill(draft)
            raise ModelError("no luck")

        with pytest.raises(ModelError, match="no luck"):
            cached("key", fail)
        assert list(place.iterdir()) == []

    def test_lets_the_first_of_two_processes_win(self, place: Path) -> None:
        context = multiprocessing.get_context("fork")
        barrier, seen = context.Barrier(2), context.Queue()
        processes = [context.Process(target=race, args=(barrier, seen)) for _ in range(2)]
        for process in processes:
            process.start()
        assert [seen.get(timeout=PATIENCE_S), seen.get(timeout=PATIENCE_S)] == ["once", "once"]
        for process in processes:
            process.join(timeout=PATIENCE_S)
        assert [process.exitcode for process in processes] == [0, 0]
        assert [entry.name for entry in place.iterdir()] == ["shared"]

    def test_is_in_the_home_folder_by_default(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        for elsewhere in ("", "relative/path"):
            monkeypatch.setenv("XDG_CACHE_HOME", elsewhere)
            assert cached("key", fill) == tmp_path / "home" / ".cache" / "segway-ecc" / "models" / "key"

    def test_reports_that_it_cannot_be_written(self, tmp_path: Path) -> None:
        (tmp_path / "segway-ecc").write_text("in the way")
        with pytest.raises(ModelError, match=r"cannot write to the cache .*; set XDG_CACHE_HOME elsewhere"):
            cached("key", fill)


@pytest.mark.compiler
@pytest.mark.parametrize(("variable", "cpp"), [("CC", False), ("CXX", True)])
def test_a_variable_names_the_compiler_with_its_options(
    monkeypatch: pytest.MonkeyPatch, variable: str, *, cpp: bool
) -> None:
    monkeypatch.setenv(variable, "gcc -ffp-contract=fast")
    compiler, *options = find_compiler(cpp=cpp)
    assert Path(compiler).name == "gcc"
    # The last one decides.
    assert options == ["-ffp-contract=fast", "-ffp-contract=off", "-fsigned-char"]


def test_a_compiler_that_makes_nothing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "true")
    with pytest.raises(ModelError, match=r"^the compiler \S*true ended well and wrote nothing: let CC and"):
        run_compiler(["-o", "model.so"], folder=tmp_path)


def test_whatever_compiler_there_is_counts_and_its_absence_is_named_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    assert missing_compiler() == "there is no C compiler here: sudo apt install gcc libc6-dev"

    for name in ("clang", "my-cc"):
        (tmp_path / name).touch(0o755)
    assert missing_compiler() is None
    monkeypatch.setenv("CC", "my-cc -O1")
    assert missing_compiler() is None
    monkeypatch.setenv("CC", "none-of-these")
    assert missing_compiler() == "there is no compiler none-of-these, which the variable CC names: install it"
