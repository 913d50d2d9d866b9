# SPDX-License-Identifier: MIT
"""What other code may import."""

import subprocess
import sys

import pytest

import segway_ecc
from segway_ecc import drives, testing


@pytest.mark.parametrize("name", segway_ecc.__all__)
def test_a_public_name_is_there_and_documented(name: str) -> None:
    assert getattr(segway_ecc, name).__doc__


@pytest.mark.parametrize("name", testing.__all__)
def test_a_public_fake_is_there_and_documented(name: str) -> None:
    assert getattr(testing, name).__doc__


@pytest.mark.parametrize("name", drives.__all__)
def test_a_public_part_of_a_drive_family_is_there_and_documented(name: str) -> None:
    assert getattr(drives, name).__doc__


def test_dir_shows_public_names_before_their_first_use() -> None:
    assert set(segway_ecc.__all__) <= set(dir(segway_ecc))


def test_a_name_that_is_not_public_is_refused() -> None:
    with pytest.raises(AttributeError, match=r"^module 'segway_ecc' has no attribute 'Loop'$"):
        _ = segway_ecc.Loop


def test_importing_the_package_imports_nothing_else_of_ours() -> None:
    code = "import sys, segway_ecc; print(*(name for name in sys.modules if name.startswith('segway_ecc')))"
    found = subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True)
    assert found.stdout.split() == ["segway_ecc"]
