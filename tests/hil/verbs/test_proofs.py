# SPDX-License-Identifier: MIT
import importlib.util
from pathlib import Path

import pytest

from segway_ecc.hil.verbs.proofs import has_figures, make_folder, writing_to
from segway_ecc.node.errors import ConfigurationError


def test_a_folder_is_made_with_those_above_it_and_may_be_there(tmp_path: Path) -> None:
    for _ in range(2):
        make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()


def test_what_cannot_be_written_is_a_configuration_error(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(ConfigurationError, match=r"cannot write to .*: Not a directory; choose another --out"):
        make_folder(file / "below")
    with pytest.raises(ConfigurationError, match="choose another --out"), writing_to(tmp_path):
        (tmp_path / "not there" / "x").touch()


@pytest.mark.parametrize("is_there", [True, False])
def test_figures_need_the_library_and_its_lack_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *, is_there: bool
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object() if is_there else None)
    assert has_figures() is is_there
    assert ("install 'segway-ecc[report]'" in capsys.readouterr().err) is not is_there
