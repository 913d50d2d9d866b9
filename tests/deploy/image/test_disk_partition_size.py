# SPDX-License-Identifier: MIT
"""The size of the data partition."""

from pathlib import Path

import pytest

from segway_ecc.deploy.image.disk import MIB, RELEASES, PartitionContent, log_limit, partition_content
from segway_ecc.deploy.image.recipe import ImageError


def test_the_data_partition_holds_what_it_must(tmp_path: Path) -> None:
    release, system = tmp_path / "release", tmp_path / "var"
    for folder, name, size in ((release, "code.py", 3 * MIB + 1), (system, "state", 1)):
        folder.mkdir()
        (folder / name).write_bytes(bytes(size))
    found = partition_content(release, 5 * MIB, system, None)
    assert found == PartitionContent(8 * MIB + 4096, 2_000_000_000, 4096)
    content = RELEASES * found.release + 2_000_000_000 + 4096 + 100 * MIB
    assert 1.05 * content < found.mib * MIB < 1.15 * content


def test_a_data_partition_that_is_too_small_is_refused_with_what_it_takes() -> None:
    needed = PartitionContent(400_000_000, 2_000_000_000, 0)
    assert needed.mib > (RELEASES * 400 + 2000) * 1e6 / MIB
    needed.check(needed.mib)
    with pytest.raises(ImageError, match=rf"of {needed.mib - 1} MiB is too small: 2000 MB of logs .* {needed.mib} MiB"):
        needed.check(needed.mib - 1)


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("", 2_000_000_000),
        ("ROS_DOMAIN_ID=3\nRUN_OPTIONS=--no-ros\n", 2_000_000_000),
        ("RUN_OPTIONS=--no-ros --log-limit 300\n", 300_000_000),
        ('RUN_OPTIONS="--log-limit=1.5 --no-ros"\n', 1_500_000),
        ("#RUN_OPTIONS=--log-limit 7\nRUN_OPTIONS=--log-limit 8\nRUN_OPTIONS=--log-limit 9\n", 9_000_000),
    ],
)
def test_the_limit_of_logs_is_that_of_the_configuration(text: str, limit: int, tmp_path: Path) -> None:
    assert log_limit(None) == log_limit(tmp_path) == 2_000_000_000
    (tmp_path / "environment").write_text(text, "ascii")
    assert log_limit(tmp_path) == limit


@pytest.mark.parametrize("limit", ["much", "", "inf", "nan", "'"])
def test_a_limit_that_is_no_number_is_refused(limit: str, tmp_path: Path) -> None:
    (tmp_path / "environment").write_text(f"RUN_OPTIONS=--log-limit {limit}\n", "ascii")
    with pytest.raises(ImageError, match=r"--log-limit in RUN_OPTIONS must be a number of MB"):
        log_limit(tmp_path)
