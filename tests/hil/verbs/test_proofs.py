# SPDX-License-Identifier: MIT
import argparse
import importlib.util
from pathlib import Path

import pytest

from segway_ecc.hil.verbs.proofs import claims_out, has_figures, writing_to
from segway_ecc.node.errors import ConfigurationError


@claims_out
def make_folder(options: argparse.Namespace) -> int:
    return 3 if options.out is None or options.out.is_dir() else 0


def test_a_folder_is_made_with_those_above_it_and_may_be_there(tmp_path: Path) -> None:
    for out in (tmp_path / "a" / "b", tmp_path / "a" / "b", None):
        assert make_folder(argparse.Namespace(out=out)) == 3


def test_what_cannot_be_written_is_a_configuration_error(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(ConfigurationError, match=r"cannot write to .*: Not a directory; choose another --out"):
        make_folder(argparse.Namespace(out=file / "below"))
    with pytest.raises(ConfigurationError, match="choose another --out"), writing_to(tmp_path):
        (tmp_path / "not there" / "x").touch()


@pytest.mark.parametrize("is_there", [True, False])
def test_figures_need_the_library_and_its_lack_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *, is_there: bool
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object() if is_there else None)
    assert has_figures() is is_there
    assert ("install 'segway-ecc[report]'" in capsys.readouterr().err) is not is_there
