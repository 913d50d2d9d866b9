# SPDX-License-Identifier: MIT
"""Where a user's files go, and what a user is told who has no place for them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.folders import cache_folder, state_folder

FOLDERS = [(cache_folder, "XDG_CACHE_HOME", ".cache"), (state_folder, "XDG_STATE_HOME", ".local/state")]


@pytest.mark.parametrize(("folder", "variable", "below_home"), FOLDERS)
def test_it_is_the_named_one_or_below_the_home_folder(
    folder: Callable[[], Path], variable: str, below_home: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/home/one")
    for given, expected in (("/given", "/given"), ("", f"/home/one/{below_home}"), ("x", f"/home/one/{below_home}")):
        monkeypatch.setenv(variable, given)
        assert folder() == Path(expected) / "segway-ecc"


@pytest.mark.parametrize(("folder", "variable", "below_home"), FOLDERS)
def test_a_user_without_a_home_folder_is_told_what_to_set(
    folder: Callable[[], Path], variable: str, below_home: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    del below_home
    for name in ("HOME", variable):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("os.getuid", lambda: 4_000_000_000)
    with pytest.raises(ConfigurationError, match=rf"^this user has no home folder: set HOME, or {variable}$"):
        folder()
