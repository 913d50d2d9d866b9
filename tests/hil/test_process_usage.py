# SPDX-License-Identifier: MIT
"""Against a /proc of our own (proc(5) says what stands where)."""

import os
from pathlib import Path

import pytest

from segway_ecc.hil.process_usage import Memory, cpu_s, memory, tree


def process(proc: Path, pid: int, parent: int, *, ticks: tuple[int, int] = (0, 0), name: str = "python") -> Path:
    folder = proc / str(pid)
    folder.mkdir(parents=True)
    fields = ["S", str(parent), *(["0"] * 9), *map(str, ticks), *(["0"] * 30)]
    (folder / "stat").write_text(f"{pid} ({name}) {' '.join(fields)}\n", encoding="utf-8")
    return folder


def thread(folder: Path, tid: int, ran_ns: int) -> None:
    task = folder / "task" / str(tid)
    task.mkdir(parents=True)
    (task / "schedstat").write_text(f"{ran_ns} 17 3\n", encoding="utf-8")


def rollup(folder: Path, rss_kb: int, pss_kb: int) -> None:
    text = f"00400000-7fff ---p 00000000 00:00 0 [rollup]\nRss: {rss_kb:>10} kB\nPss: {pss_kb:>10} kB\nPss_Anon: 1 kB\n"
    (folder / "smaps_rollup").write_text(text, encoding="ascii")


def test_a_tree_is_a_process_with_its_children_and_theirs(tmp_path: Path) -> None:
    for pid, parent in ((1, 0), (10, 1), (11, 10), (12, 11), (20, 1)):
        process(tmp_path, pid, parent)
    (tmp_path / "self").mkdir()
    assert tree(10, tmp_path) == [10, 11, 12]


def test_a_name_with_brackets_and_spaces_does_not_mislead(tmp_path: Path) -> None:
    process(tmp_path, 10, 1)
    process(tmp_path, 11, 10, name="a) S 99 (b")
    assert tree(10, tmp_path) == [10, 11]


def test_cpu_time_is_that_of_all_threads_by_the_scheduler(tmp_path: Path) -> None:
    one, other = process(tmp_path, 10, 1, ticks=(900, 0)), process(tmp_path, 11, 10)
    thread(one, 10, 250_000_000)
    thread(one, 13, 500_000_000)
    thread(other, 11, 1_000_000_000)
    assert cpu_s([10, 11], tmp_path) == pytest.approx(1.75)


def test_where_the_scheduler_does_not_count_ticks_do(tmp_path: Path) -> None:
    process(tmp_path, 10, 1, ticks=(30, 12))
    assert cpu_s([10], tmp_path) == pytest.approx(42 / os.sysconf("SC_CLK_TCK"))


def test_memory_is_summed_and_a_process_that_ended_holds_none(tmp_path: Path) -> None:
    rollup(process(tmp_path, 10, 1), 3000, 2000)
    rollup(process(tmp_path, 11, 10), 100, 40)
    assert memory([10, 11, 12], tmp_path) == Memory(rss=3100 * 1024, pss=2040 * 1024)
    assert cpu_s([12], tmp_path) == 0.0


def test_this_process_itself_has_used_time_and_memory() -> None:
    mine = tree(os.getpid())
    assert mine[0] == os.getpid()
    assert cpu_s(mine) > 0.0
    assert memory(mine).rss >= memory(mine).pss > 0
