# SPDX-License-Identifier: MIT
"""Where a run comes from, as its log records it."""

import importlib.metadata
import importlib.resources
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from segway_ecc.node.config import convert_robot, load_robot, packaged_robots, read_text
from segway_ecc.node.models.load import load_model
from segway_ecc.node.recording.layout import surroundings
from segway_ecc.node.recording.robot_provenance import model_hash, provenance_of


@pytest.mark.parametrize("name", packaged_robots())
def test_a_robot_file_comes_back_as_it_was(name: str) -> None:
    file = load_robot(name)
    load_model(file.model.source)
    provenance = provenance_of(file, read_text(name))

    assert convert_robot(msgspec.json.decode(provenance.attachments["robot.json"]), name) == file
    assert provenance.attachments["robot.yaml"] == read_text(name)


def test_the_wire_of_the_board_is_described_where_it_is_used() -> None:
    dbc = (
        importlib.resources.files("segway_ecc.firmware_io")
        .joinpath("drives/wheel_board/wheel_board.dbc")
        .read_text("utf-8")
    )

    assert provenance_of(load_robot("cart-can")).attachments["wheel_board.dbc"] == dbc
    assert "wheel_board.dbc" not in provenance_of(load_robot("cart-odrive")).attachments


def test_software_machine_and_model_are_named() -> None:
    file = load_robot("cart")
    load_model(file.model.source)
    metadata = provenance_of(file).metadata | surroundings()

    assert metadata["model"] == {
        "source": "segway_ecc.node.models.cart:Cart",
        "sha256": model_hash("segway_ecc.node.models.cart:Cart"),
    }
    assert metadata["software"]["segway-ecc"] == importlib.metadata.version("segway-ecc")
    assert metadata["software"]["mcap"] == importlib.metadata.version("mcap")
    assert metadata["machine"]["host"] == platform.node()
    assert metadata["machine"]["python"] == sys.version
    assert metadata["machine"]["libc"] == os.confstr("CS_GNU_LIBC_VERSION")


def test_a_folder_is_known_by_all_its_files(tmp_path: Path) -> None:
    folder, hashes = tmp_path / "code", set()
    (folder / "sub").mkdir(parents=True)
    for change in (
        lambda: (folder / "a.c").write_text("int a;"),
        lambda: (folder / "sub" / "b.c").write_text("int b;"),
        lambda: (folder / "sub" / "b.c").write_text("int c;"),
        lambda: (folder / "sub" / "b.c").rename(folder / "sub" / "d.c"),
    ):
        change()
        hashes.add(model_hash(str(folder)))

    assert len(hashes) == 4
    assert folder.rename(tmp_path / "elsewhere").exists()
    assert model_hash(str(tmp_path / "elsewhere")) in hashes


def test_an_fmu_is_known_by_its_content(tmp_path: Path) -> None:
    for name, content in (("a.fmu", b"1"), ("b.fmu", b"1"), ("c.fmu", b"2")):
        (tmp_path / name).write_bytes(content)
    a, b, c = (model_hash(str(tmp_path / name)) for name in ("a.fmu", "b.fmu", "c.fmu"))

    assert a == b != c


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a model in Python that uses a module beside it."""
    (tmp_path / "beside_of_ours.py").write_text("GAIN = 1.0\ndef gain():\n    return GAIN\n")
    (tmp_path / "model_of_ours.py").write_text(
        "import math\n"
        "from beside_of_ours import gain\n"
        "from segway_ecc.node.models.cart import Cart\n"
        "class Model(Cart):\n"
        "    factor = gain() * math.pi\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in ("model_of_ours", "beside_of_ours"):
        sys.modules.pop(name, None)


def test_a_model_in_python_is_known_by_its_module_and_those_beside_it(folder: Path) -> None:
    source = "model_of_ours:Model"
    load_model(source)
    first = model_hash(source)
    (folder / "unrelated.py").write_text("1")
    assert model_hash(source) == first
    (folder / "beside_of_ours.py").write_text("GAIN = 2.0\ndef gain():\n    return GAIN\n")
    second = model_hash(source)
    (folder / "model_of_ours.py").write_text("# another\n")

    assert len({first, second, model_hash(source)}) == 3
