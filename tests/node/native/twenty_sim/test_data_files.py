# SPDX-License-Identifier: MIT
import re
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.load import load_native
from tests.fixtures.twenty_sim import generate, models
from tests.fixtures.twenty_sim.made import Made

READING = """
double XXTable (const char *name, double x, int id)
{
	double value = -1.0;
	FILE *file = fopen (name, "r");
	if (file) { fscanf (file, "%lf", &value); fclose (file); }
	return value;
}
"""


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "compiled"))


def with_table(made: Made, name: str) -> Path:
    """The tank with a level that is read from a table."""
    file = next(made.path.rglob(name))
    text = file.read_text(encoding="utf-8")
    place = "xx_V[0]" if name == "xxmodel.c" else "m_V[0]"
    start = re.search(r"CalculateOutput\s*\(void\)\s*\{", text)
    assert start
    head, rest = text[: start.end()], text[start.end() :]
    call = f'\n\t{place} = XXTable ("C:\\\\data\\\\Gains.txt", 0.0, 0);'
    file.write_text(f"#include <stdio.h>\n{READING}{head}{call}{rest}", encoding="utf-8")
    return made.path


@pytest.fixture(params=["c", "cpp"])
def tank(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "c":
        return with_table(generate.submodel(models.LIMITER, tmp_path / "tank"), "xxmodel.c")
    return with_table(generate.cpp_class(models.LIMITER, tmp_path / "tank"), "Limiter.cpp")


def test_a_table_that_is_not_there_is_named(tank: Path) -> None:
    with pytest.raises(ModelError, match=r"in .* reads Gains.txt, which is not in the folder: add it$"):
        load_native(tank)


@pytest.mark.variants(1)
def test_a_table_is_read_wherever_the_process_runs(tank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tank / "tables").mkdir()
    (tank / "tables" / "gains.txt").write_text("0.75\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    model = load_native(tank)
    assert model.initialize([0.0]) == [0.75]
    assert model.step([0.0]) == [0.75]


@pytest.mark.variants(1)
def test_another_table_is_another_model(tank: Path) -> None:
    for value in ("0.25", "0.5"):
        (tank / "Gains.txt").write_text(value, encoding="utf-8")
        assert load_native(tank).initialize([0.0]) == [float(value)]
