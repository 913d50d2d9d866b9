# SPDX-License-Identifier: MIT
import functools
import gc
import math
import subprocess
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError, UnknownNameError
from segway_ecc.node.model.model import Write
from segway_ecc.node.native.fmu.load import FmuModel, load_fmu
from tests.fixtures.tiny_fmu import make
from tests.fixtures.tiny_fmu.make import NAME_OF_INPUT, Shape, compile_model, description, sources, truth

GAIN, FACTOR, X = 0, 1, 6
STEPS = 10_000
SHAPES = pytest.mark.parametrize("shape", list(Shape), ids=lambda shape: shape.name)
DESCRIPTION = "modelDescription.xml"


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache for all tests of this file, so that the shim is compiled once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _cache(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept))


@pytest.fixture
def packed(tmp_path: Path) -> Callable[..., Path]:
    return functools.partial(make.packed, tmp_path)


def run(model: FmuModel, steps: int, writes: dict[int, tuple[str, float]] | None = None) -> list[list[float]]:
    rows = [model.initialize([1.0])]
    for k in range(1, steps + 1):
        if writes and k in writes:
            model.write(*writes[k])
        rows.append(model.step([1.0 + 0.001 * (k - 1)]))
    return rows


class TestNumbers:
    @pytest.mark.variants(2)
    @SHAPES
    def test_are_those_of_the_fmu_driven_in_c(self, shape: Shape, packed: Callable[..., Path], tmp_path: Path) -> None:
        # The experiment in the FMU ends after 1 s, and these are 100 s.
        assert run(load_fmu(packed(shape)), STEPS) == truth(shape, tmp_path, STEPS)

    @pytest.mark.variants(2)
    @SHAPES
    def test_follow_writes_to_parameters(self, shape: Shape, packed: Callable[..., Path], tmp_path: Path) -> None:
        rows = run(load_fmu(packed(shape)), 300, {100: ("Controller.gain", 2.0), 200: ("Plant.scale factor", 3.0)})
        assert rows == truth(shape, tmp_path, 300, [(100, GAIN, 2.0), (200, FACTOR, 3.0)])
        assert rows[:100] == truth(shape, tmp_path, 99)
        assert rows[100] != truth(shape, tmp_path, 100)[100]

    def test_follow_a_write_through_the_static_equations(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        model = load_fmu(packed(Shape.OLD))
        rows = run(model, 50, {11: ("Plant.scale factor", 6.0)})
        plain = truth(Shape.OLD, tmp_path, 50)
        # dx/dt is 2 factor u larger by (12 - 3) u, u = 1.01 in step 11, and one step is 0.01 s.
        assert rows[11][0] - plain[11][0] == pytest.approx(0.01 * 9.0 * 1.01, rel=1e-12)

    def test_follow_a_state_of_20_sim_written_while_running(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        rows = run(load_fmu(packed(Shape.NEW)), 50, {20: ("Plant.x", 4.0)})
        assert rows == truth(Shape.NEW, tmp_path, 50, [(20, X, 4.0)])

    @SHAPES
    def test_do_not_depend_on_another_instance(self, shape: Shape, packed: Callable[..., Path], tmp_path: Path) -> None:
        path = packed(shape)
        one, two = load_fmu(path), load_fmu(path)
        two.write("Controller.gain", 5.0)
        rows = [one.initialize([1.0])]
        other = [two.initialize([0.0])]
        for k in range(200):
            rows.append(one.step([1.0 + 0.001 * k]))
            other.append(two.step([0.0]))
        assert rows == truth(shape, tmp_path, 200)
        assert other[200] != rows[200]
        assert one.read("Controller.gain") == 0.75

    @SHAPES
    def test_are_the_same_after_it_is_initialized_again(
        self, shape: Shape, packed: Callable[..., Path], tmp_path: Path
    ) -> None:
        model = load_fmu(packed(shape))
        first = run(model, 100)
        assert run(model, 100) == first
        model.terminate()
        assert run(model, 100) == first == truth(shape, tmp_path, 100)

    @pytest.mark.variants(2)
    @SHAPES
    def test_are_the_same_from_its_sources(self, shape: Shape, packed: Callable[..., Path], tmp_path: Path) -> None:
        names = ("binaries/linux64/tiny.so", "binaries/x86_64-linux/tiny.so")
        path = packed(shape, {**dict.fromkeys(names), **sources(shape), "binaries/win64/tiny.dll": b"MZ"})
        assert run(load_fmu(path), 100) == truth(shape, tmp_path, 100)

    def test_are_the_same_under_names_with_the_models_prefix(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        names = (
            "Instantiate",
            "SetupExperiment",
            "EnterInitializationMode",
            "ExitInitializationMode",
            "DoStep",
            "SetReal",
        )
        flags = [f"-Dfmi2{name}=tiny_fmi2{name}" for name in (*names, "GetReal", "Terminate", "FreeInstance")]
        library = compile_model(Shape.OTHER, tmp_path / "prefixed" / "tiny.so", *flags)
        path = packed(Shape.OTHER, {"binaries/linux64/tiny.so": library.read_bytes()})
        assert run(load_fmu(path), 10) == truth(Shape.OTHER, tmp_path, 10)


class TestWrites:
    @SHAPES
    def test_to_a_tunable_parameter_are_kept_when_it_is_initialized(
        self, shape: Shape, packed: Callable[..., Path]
    ) -> None:
        model = load_fmu(packed(shape))
        assert model.read("Plant.scale factor") == 1.5
        model.write("Plant.scale factor", 4.0)
        assert model.read("Plant.scale factor") == 4.0
        model.initialize([0.0])
        # x0 + h (2 factor u - gain x0 + sin 0) + u / 2, with u = 1
        assert model.step([1.0])[0] == pytest.approx(0.25 + 0.01 * (8.0 - 0.75 * 0.25) + 0.5, rel=1e-12)

    @pytest.mark.parametrize("shape", [Shape.NEW, Shape.OTHER, Shape.FMI3], ids=lambda shape: shape.name)
    def test_to_a_fixed_parameter_wait_for_the_next_start(self, shape: Shape, packed: Callable[..., Path]) -> None:
        model = load_fmu(packed(shape))
        model.initialize([0.0])
        model.write("x_initial", 3.0)
        assert model.read("x_initial") == 0.25
        assert model.initialize([0.0]) == [3.0, 6.0]
        assert model.read("x_initial") == 3.0

    def test_to_a_fixed_parameter_are_refused_where_they_would_be_lost(self, packed: Callable[..., Path]) -> None:
        with pytest.raises(
            ModelError, match=r"'x_initial' of model 'tiny' cannot be written: .*starts before it takes it"
        ):
            load_fmu(packed(Shape.OLD)).write("x_initial", 3.0)

    def test_to_names_that_are_not_there_are_refused(self, packed: Callable[..., Path]) -> None:
        with pytest.raises(UnknownNameError, match=r"'Kp'; there is Plant\.y, "):
            load_fmu(packed(Shape.NEW)).write("Kp", 1.0)

    def test_reach_a_state_only_while_it_runs(self, packed: Callable[..., Path]) -> None:
        model = load_fmu(packed(Shape.OLD))
        model.initialize([0.0])
        model.write("Plant.x", 2.0)
        assert model.read("Plant.x") == 2.0
        model.initialize([0.0])
        assert model.read("Plant.x") == 0.25


class TestReads:
    @SHAPES
    def test_follow_the_model(self, shape: Shape, packed: Callable[..., Path]) -> None:
        model = load_fmu(packed(shape))
        assert model.read("Plant.x") == 0.25
        rows = run(model, 3)
        assert [model.read("Plant.y"), model.read("Plant.z")] == rows[3]
        assert model.read(NAME_OF_INPUT) == 1.002
        assert model.read("Plant.x") == pytest.approx(rows[3][0] - 0.501, rel=1e-12)
        model.terminate()
        assert model.read("Plant.y") == rows[3][0]


class TestLife:
    @SHAPES
    def test_begins_with_initialize_and_ends_with_terminate(self, shape: Shape, packed: Callable[..., Path]) -> None:
        model = load_fmu(packed(shape))
        with pytest.raises(ModelError, match="model 'tiny' failed to step: it is not initialized yet"):
            model.step([1.0])
        model.terminate()
        model.initialize([1.0])
        model.terminate()
        with pytest.raises(ModelError, match="it is terminated: initialize it again"):
            model.step([1.0])

    def test_goes_on_after_a_failure_when_it_is_initialized_again(self, packed: Callable[..., Path]) -> None:
        model = load_fmu(packed(Shape.NEW))
        model.initialize([0.0])
        model.write("Plant.x", 2e6)
        with pytest.raises(ModelError, match=r"failed to step: its step fails: x is 2000000\.0, 100% too large$"):
            model.step([0.0])
        with pytest.raises(ModelError, match="it failed earlier: initialize it again"):
            model.step([0.0])
        assert model.initialize([0.0]) == [0.25, 0.5]

    @pytest.mark.parametrize("shape", [Shape.OLD, Shape.FMI3], ids=lambda shape: shape.name)
    def test_may_be_ended_by_the_model(self, shape: Shape, packed: Callable[..., Path]) -> None:
        model = load_fmu(packed(shape))
        model.initialize([1e9])
        # x grows by 0.01 s x 3 x 1e9 = 3e7, and the model asks to stop beyond 1e6.
        model.step([0.0])
        assert model._step(model._u, model._y) == 0
        model._u[0] = 1e9
        assert model._step(model._u, model._y) == 1

    def test_leaves_nothing_behind(
        self, packed: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = packed(Shape.OLD)
        place = tmp_path / "temporary"
        place.mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(place))
        model = load_fmu(path)
        model.initialize([0.0])
        assert [entry.name[:15] for entry in place.iterdir()] == ["segway-ecc-fmu-"]
        del model
        gc.collect()
        assert list(place.iterdir()) == []

    def test_reaches_its_resources_from_where_the_library_lies(
        self, packed: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = packed(Shape.OLD)
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        model = load_fmu(path)
        (table,) = tmp_path.glob("segway-ecc-fmu-*/binaries/linux64/../../resources/table.txt")
        assert table.read_bytes() == b"1 2 3\n"
        assert model.name == "tiny"


class TestFiles:
    def test_of_the_user_are_not_written(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        path = packed(Shape.NEW)
        before = (path.read_bytes(), path.stat().st_mtime_ns, sorted(tmp_path.iterdir()))
        path.chmod(0o444)
        run(load_fmu(path), 3)
        assert (path.read_bytes(), path.stat().st_mtime_ns, sorted(tmp_path.iterdir())) == before

    def test_are_unpacked_and_compiled_once(
        self, packed: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = packed(Shape.NEW, {"binaries/linux64/tiny.so": None, **sources(Shape.NEW)})
        first = run(load_fmu(path), 5)

        def never(*_: object, **__: object) -> None:
            raise AssertionError

        monkeypatch.setattr(zipfile, "ZipFile", never)
        monkeypatch.setattr(subprocess, "run", never)
        assert run(load_fmu(path.rename(tmp_path / "same content.fmu")), 5) == first

    def test_in_the_cache_lie_in_whole_entries(self, packed: Callable[..., Path], kept: Path) -> None:
        load_fmu(packed(Shape.NEW))
        names = [entry.name for entry in (kept / "segway-ecc" / "models").iterdir()]
        assert names
        assert all(len(name) == 32 and not name.startswith(".") for name in names)

    def test_written_on_windows_are_taken(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        path = packed(Shape.NEW)
        with zipfile.ZipFile(path) as archive:
            held = {name: archive.read(name) for name in archive.namelist()}
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in held.items():
                entry = zipfile.ZipInfo("x")
                entry.filename = name.replace("/", "\\")
                archive.writestr(entry, content)
        assert run(load_fmu(path), 5) == truth(Shape.NEW, tmp_path, 5)


def test_a_step_may_be_given(packed: Callable[..., Path]) -> None:
    model = load_fmu(packed(Shape.OTHER, {DESCRIPTION: description(Shape.OTHER, step=False)}), step_size=0.02)
    assert model.step_size == 0.02
    model.initialize([0.0])
    model.step([0.0])
    # Two of the model's own steps: x = x0 + h (-gain x0), then x + h (-gain x + sin h).
    x = 0.25 + 0.01 * (-0.75 * 0.25)
    assert model.read("Plant.x") == pytest.approx(x + 0.01 * (-0.75 * x + math.sin(0.01)), rel=1e-12)


def test_static_parameters_are_distinguished_where_the_sources_show_them(packed: Callable[..., Path]) -> None:
    model = load_fmu(packed(Shape.OLD, sources(Shape.OLD)))
    writes = {variable.name: (variable.write, variable.why) for variable in model.parameters}
    assert writes["Controller.gain"] == (Write.NOW, "tunable, and feeds no static equation")
    assert writes["Plant.scale factor"] == (Write.STATIC, "feeds static equations")
