# SPDX-License-Identifier: MIT
"""Models that the user names: beside the robot file or the log, in the current folder, or installed, in this order."""

import ast
import importlib.util
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ModelError
from segway_ecc.node.models import load as module
from segway_ecc.node.models.load import PythonSource, load_model, locate, locate_recorded
from segway_ecc.node.recording.robot_provenance import model_hash

Run = Callable[..., Any]
ROOT = Path(__file__).parents[3]
TANK = """
from segway_ecc import Method, SectionedModel, Variable
{more}
class Tank(SectionedModel):
    name = "{name}"
    step_size = 0.01
    method = Method.EULER
    inputs = (Variable("in", "m3/s"),)
    states = (Variable("Volume", "m3"),)
    outputs = (Variable("Level", "m"),)

    def input(self, u):
        self.inflow = u[0]

    def dynamic(self, t, s):
        return (self.inflow,)

    def output(self):
        return (self.s[0],)
"""
ROBOT = "name: tank\nmodel: {{source: '{}'}}\nwiring: {{in: setpoint.linear_velocity, Level: topic.level}}\n"


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    modules, path = dict(sys.modules), list(sys.path)
    yield
    assert sys.path == path, "a folder was left on the path"
    for name in set(sys.modules) - set(modules):
        if name.partition(".")[0] not in {"segway_ecc", "numpy"}:
            del sys.modules[name]


def write(path: Path, name: str = "tank", more: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(TANK.format(name=name, more=more))
    return path


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("tank.py", "tank:Tank"),
        ("tank/__init__.py", "tank:Tank"),
        ("tank/sub.py", "tank.sub:Tank"),
        ("deep/tank.py", "deep/tank:Tank"),
    ],
)
def test_a_model_beside_the_robot_file_is_found(tmp_path: Path, file: str, source: str) -> None:
    path = write(tmp_path / "robots" / file)
    if path.name == "sub.py":
        path.with_name("__init__.py").touch()
    robot = tmp_path / "robots" / "mine.yaml"
    robot.write_text(ROBOT.format(source))
    found = load_robot(str(robot)).model.source

    assert found == f"{(tmp_path / 'robots' / source).parent}/{source.rpartition('/')[2]}"
    assert load_model(found).name == "tank"


def test_the_plant_is_found_too(tmp_path: Path) -> None:
    write(tmp_path / "pool.py")
    robot = tmp_path / "mine.yaml"
    robot.write_text(ROBOT.format("segway_ecc.node.models.cart:Cart") + "simulation: {plant: 'pool:Tank'}\n")
    simulation = load_robot(str(robot)).simulation

    assert simulation is not None
    assert simulation.plant == f"{tmp_path}/pool:Tank"


def test_the_robot_files_folder_comes_before_the_current_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("robots", "here"):
        write(tmp_path / folder / "tank.py", folder)
    write(tmp_path / "here" / "pond.py")
    monkeypatch.chdir(tmp_path / "here")
    folders = (tmp_path / "robots", Path())

    assert locate("tank:Tank", folders) == f"{tmp_path}/robots/tank:Tank"
    assert locate("pond:Tank", folders) == f"{tmp_path}/here/pond:Tank"
    assert locate("lake:Tank", folders) == "lake:Tank"


def test_nothing_beside_the_model_is_imported(tmp_path: Path) -> None:
    write(tmp_path / "tank.py", more="import helper_of_tank")
    (tmp_path / "helper_of_tank.py").touch()
    text = (
        rf"^cannot load model '{tmp_path}/tank:Tank': it imports 'helper_of_tank', which is not installed: install it, "
        r"or make the model a package, a folder with __init__.py, that holds it$"
    )
    with pytest.raises(ModelError, match=text):
        load_model(locate("tank:Tank", [tmp_path]))
    assert "tank" not in sys.modules


def test_a_package_holds_what_its_model_imports(tmp_path: Path) -> None:
    write(tmp_path / "tank" / "model.py", more="from tank.helper import A\nfrom . import helper\nassert helper.A == A")
    (tmp_path / "tank" / "helper.py").write_text("A = 1\n")
    (tmp_path / "tank" / "__init__.py").touch()

    assert load_model(locate("tank.model:Tank", [tmp_path])).name == "tank"


@pytest.mark.parametrize(
    ("name", "holder"),
    [
        ("json", "Python's standard library"),
        ("fractions", "Python's standard library"),
        ("can", "a package that segway-ecc uses"),
        ("pytest", f"another module, {importlib.util.find_spec('pytest').origin}"),  # type: ignore[union-attr]
    ],
)
def test_a_name_that_is_taken_is_refused(tmp_path: Path, name: str, holder: str) -> None:
    write(tmp_path / f"{name}.py")
    text = rf"^cannot load {tmp_path}/{name}.py: the name '{name}' is taken by {holder}; rename the file$"
    with pytest.raises(ModelError, match=text):
        load_model(locate(f"{name}:Tank", [tmp_path]))


def test_two_models_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        write(tmp_path / folder / "tank.py", folder)

    assert load_model(f"{tmp_path}/a/tank:Tank").name == "a"
    assert load_model(f"{tmp_path}/a/tank:Tank").name == "a"
    with pytest.raises(ModelError, match=rf"taken by another module, {tmp_path}/a/tank.py; rename the file$"):
        load_model(f"{tmp_path}/b/tank:Tank")


def test_a_folder_without_the_module_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=rf"^there is no module or package 'tank' in {tmp_path}$"):
        load_model(f"{tmp_path}/tank:Tank")


def test_a_submodule_that_is_not_there_is_named(tmp_path: Path) -> None:
    write(tmp_path / "tank" / "__init__.py")
    with pytest.raises(ModelError, match=r"tank.sub:Tank': No module named 'tank.sub'$"):
        load_model(f"{tmp_path}/tank.sub:Tank")


def test_a_module_with_a_wrong_line_is_named(tmp_path: Path) -> None:
    (tmp_path / "tank.py").write_text("class Tank(:\n")
    with pytest.raises(ModelError, match=rf"^cannot load model '{tmp_path}/tank:Tank': invalid syntax"):
        load_model(f"{tmp_path}/tank:Tank")


@pytest.mark.parametrize("source", ["node.models.cart:Cart", "hil.plants.segway:SegwayPlant"])
def test_a_name_of_version_0_1_gives_the_new_one(tmp_path: Path, source: str) -> None:
    # The folders of a checkout have these names too, and are not looked into.
    assert locate(source, [ROOT]) == source
    text = rf"^model '{source}' has the name that it had in version 0.1: write segway_ecc.{source}$"
    with pytest.raises(ModelError, match=text):
        load_model(source)
    robot = tmp_path / "old.yaml"
    robot.write_text(ROBOT.format(source))
    with pytest.raises(ModelError, match=text):
        load_model(load_robot(str(robot)).model.source)


@pytest.mark.parametrize("source", ["tank.py:Tank", "robots/tank.py:Tank"])
def test_a_file_in_place_of_a_module_is_answered_with_the_module(source: str) -> None:
    with pytest.raises(ModelError, match=rf"^'{source}' names a file: name its module, {source.replace('.py', '')}$"):
        load_model(source)


def test_our_own_package_is_never_looked_for_in_a_folder() -> None:
    assert locate("segway_ecc.node.models.cart:Cart", [ROOT]) == "segway_ecc.node.models.cart:Cart"


def test_a_recorded_model_is_found_where_it_was_or_else_beside_the_log(tmp_path: Path) -> None:
    was, log = tmp_path / "was", tmp_path / "log"
    write(was / "tank.py")
    write(log / "tank.py")
    (log / "code").mkdir()

    assert locate_recorded(f"{was}/tank:Tank", [log]) == f"{was}/tank:Tank"
    assert locate_recorded("/gone/tank:Tank", [log]) == f"{log}/tank:Tank"
    assert locate_recorded("/gone/pond:Tank", [log]) == "pond:Tank"
    assert locate_recorded("/gone/code", [log]) == f"{log}/code"
    assert locate_recorded(str(log / "code"), [was]) == f"{log}/code"


def test_the_hash_is_that_of_the_content_wherever_it_lies(tmp_path: Path) -> None:
    hashes = []
    for folder, name in (("a", "tank"), ("b", "tank"), ("c", "pond")):
        write(tmp_path / folder / "tank.py", name)
        load_model(f"{tmp_path}/{folder}/tank:Tank")
        hashes.append(model_hash(f"{tmp_path}/{folder}/tank:Tank"))
        del sys.modules["tank"]

    assert hashes[0] == hashes[1] != hashes[2]


def test_inspect_and_simulate_find_a_model_in_the_current_folder(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "tank.py")
    monkeypatch.chdir(tmp_path)

    assert segway_ecc("model", "inspect", "tank:Tank", "--json").code == 0
    assert segway_ecc("model", "simulate", "tank:Tank", "--duration", "0.1", "--input", "in=1").code == 0
    lost = segway_ecc("model", "inspect", "pond:Tank")
    assert lost.errors == ["segway-ecc: cannot load model 'pond:Tank': No module named 'pond'"]


def test_a_run_and_its_replay_find_the_model(segway_ecc: Run, tmp_path: Path) -> None:
    write(tmp_path / "robots" / "tank.py")
    robot, log = tmp_path / "robots" / "mine.yaml", tmp_path / "run.mcap"
    robot.write_text(ROBOT.format("tank:Tank"))

    assert segway_ecc("run", str(robot), "--no-ros", "--duration", "0.1", "--log", str(log)).code == 0
    assert json.loads(segway_ecc("log", "replay", str(log), "--json").out)["identical"]
    del sys.modules["tank"]
    (tmp_path / "robots" / "tank.py").rename(tmp_path / "tank.py")
    moved = json.loads(segway_ecc("log", "replay", str(log), "--json").out)
    assert (moved["identical"], moved["other_model"]) == (True, False)


@pytest.mark.parametrize(
    ("source", "parsed"),
    [
        ("tank:Tank", PythonSource(None, "tank", "Tank")),
        ("./a b/tank.sub:Tank", PythonSource(Path("a b"), "tank.sub", "Tank")),
        ("/tank:Tank", PythonSource(Path("/"), "tank", "Tank")),
        ("tank", None),
        ("a/tank.py:Tank", PythonSource(Path("a"), "tank.py", "Tank")),
        ("1:2", None),
        ("", None),
    ],
)
def test_sources_in_python_are_told_from_folders(source: str, parsed: PythonSource | None) -> None:
    assert PythonSource.parse(source) == parsed


def test_every_package_that_the_product_imports_keeps_its_name() -> None:
    imported = set()
    for path in (path for room in ("firmware_io", "node", "deploy", "hil") for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.partition(".")[0])
    imported -= {*sys.stdlib_module_names, "_typeshed"}  # which only type checkers know
    others = {name for name in imported if not name.endswith(("_msgs", "_srvs"))}

    assert others - module._OURS == set()


@pytest.mark.parametrize("source", ["n" * 5000, f"{'n' * 5000}.module:Class"])
def test_a_source_that_is_longer_than_a_path_is_nowhere(source: str, tmp_path: Path) -> None:
    assert locate(source, [tmp_path]) == source
    assert locate_recorded(source, [tmp_path]) == source
