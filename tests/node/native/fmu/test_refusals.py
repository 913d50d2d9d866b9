# SPDX-License-Identifier: MIT
import functools
import math
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.fmu import load
from segway_ecc.node.native.fmu.load import load_fmu
from tests.fixtures.tiny_fmu import make
from tests.fixtures.tiny_fmu.make import CONFIGURATION, Changes, Shape, compile_model, description, entries

DESCRIPTION = "modelDescription.xml"
OTHER = Shape.OTHER
BOMB = description(OTHER).replace("?>", '?><!DOCTYPE a [<!ENTITY b "boom"><!ENTITY c "&b;&b;&b;">]>', 1)
INTEGER = (
    '<ScalarVariable name="Mode switch" valueReference="20" causality="input"><Integer start="1"/></ScalarVariable>'
    '<ScalarVariable name="On" valueReference="21" causality="output"><Boolean/></ScalarVariable>'
)
ARRAY = (
    '<Float64 name="wheels" valueReference="20" causality="input" start="0 0"><Dimension start="2"/></Float64>'
    '<Float32 name="small" valueReference="21" causality="output"/>'
)
FAR = '<ScalarVariable name="far" valueReference="4294967296"><Real/></ScalarVariable>'
BAD_START = '<ScalarVariable name="odd" valueReference="9"><Real start="1,5"/></ScalarVariable>'


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


def refusals() -> Iterator[object]:
    tool = '<CoSimulation modelIdentifier="tiny" needsExecutionTool="true"/>'
    exchange = '<ModelExchange modelIdentifier="tiny"/>'
    climbing = '<CoSimulation modelIdentifier="../tiny"/>'
    texts = {
        "tool": (
            description(OTHER, interface=tool),
            "needs Tool 1.0 running beside it .*: export it again as a stand-alone",
        ),
        "exchange": (
            description(OTHER, interface=exchange),
            "is for ModelExchange only .*: export it again for co-simulation",
        ),
        "climbing": (
            description(OTHER, interface=climbing),
            "has the modelIdentifier '../tiny', which names no library",
        ),
        "fmi1": (description(OTHER, version="1.0"), "is FMI 1.0; FMI 2.0 and 3.0 are taken"),
        "fmi4": (description(OTHER, version="4.0"), "is FMI 4.0; FMI 2.0 and 3.0 are taken"),
        "integers": (
            description(OTHER, more=INTEGER),
            r"not real numbers: input 'Mode switch' \(Integer\), output 'On' \(Boolean\); make them real",
        ),
        "doctype": (BOMB, "is refused: it has a DOCTYPE, which no FMU needs"),
        "broken": (description(OTHER)[:-20], "is not well-formed XML: "),
        "encoding": (description(OTHER).replace("ISO-8859-1", "klingon"), "is not well-formed XML: "),
        "other": ('<?xml version="1.0"?><html/>', "is no FMU: its modelDescription.xml does not begin with"),
        "step": (
            description(OTHER, step=False),
            r"gives no step size: pass it, in s, as load_fmu\(path, step_",
        ),
        "zero": (description(OTHER).replace('"0.01"', '"0"'), r"a step of 0\.0 s cannot be taken"),
        "reference": (
            description(OTHER, more=FAR),
            "valueReference of variable 'far' in .* is '4294967296', which is no number",
        ),
        "start": (
            description(OTHER, more=BAD_START),
            "start of variable 'odd' in .* is '1,5', which is no finite number",
        ),
        "token": (
            description(OTHER).replace('guid="{', 'guid="{0'),
            r"refuses to be instantiated: Wrong GUID %s\. Expected",
        ),
    }
    for name, (text, message) in texts.items():
        yield pytest.param(OTHER, {DESCRIPTION: text}, message, id=name)
    gone = "binaries/linux64/tiny.so"
    windows = {gone: None, "binaries/win64/tiny.dll": b"MZ"}
    yield pytest.param(
        Shape.FMI3, {DESCRIPTION: description(Shape.FMI3, more=ARRAY)}, r"'wheels' \(array of Float64\), ", id="array"
    )
    wrong = {DESCRIPTION: description(Shape.FMI3).replace('Token="{', 'Token="{0')}
    yield pytest.param(Shape.FMI3, wrong, r"instantiated: Wrong token: 100%s sure$", id="token3")
    yield pytest.param(OTHER, {DESCRIPTION: None}, "is no FMU: it has no modelDescription.xml", id="no description")
    yield pytest.param(
        OTHER, {gone: None}, "it has neither binaries nor C sources; export it for .* or with sources", id="bare"
    )
    yield pytest.param(OTHER, windows, "it has binaries for win64 only, and no C sources; export it", id="windows")
    yield pytest.param(OTHER, {gone: b"MZ" * 40}, "it has binaries for linux64 only, and no C sources", id="not elf")
    arm = bytes([0x7F, *b"ELF", 2, 1, 1, *[0] * 9, 3, 0xB7, 0])
    yield pytest.param(OTHER, {gone: arm[:16] + b"\x03\x00\x28\x00"}, "binaries for linux64 only", id="other machine")
    bad = {gone: None, "sources/model.c": b"int fmi2DoStep(void) { return missing_thing; }\n"}
    yield pytest.param(OTHER, bad, "cannot compile the sources of FMU .*missing_thing", id="sources")
    yield pytest.param(
        OTHER, {"../evil.txt": b"x"}, r"its entry '\.\./evil\.txt' leads out of the FMU's own folder", id="slip"
    )
    yield pytest.param(OTHER, {"/tmp/evil.txt": b"x"}, "leads out of the FMU's own folder", id="absolute")  # noqa: S108 - refused
    yield pytest.param(OTHER, {"resources\\..\\..\\evil": b"x"}, "leads out of the FMU's own folder", id="backslash")
    tokens = {"resources/ModelConfiguration.xml": CONFIGURATION[:-10]}
    yield pytest.param(Shape.OLD, tokens, "ModelConfiguration.xml is not well-formed XML", id="configuration")


class TestRefusals:
    @pytest.mark.parametrize(("shape", "changes", "message"), list(refusals()))
    def test_give_the_reason_in_one_line(
        self, shape: Shape, changes: Changes, message: str, packed: Callable[..., Path]
    ) -> None:
        with pytest.raises(ModelError, match=message) as caught:
            load_fmu(packed(shape, changes))
        assert "\n" not in str(caught.value)

    def test_leave_nothing_outside(self, packed: Callable[..., Path], kept: Path) -> None:
        with pytest.raises(ModelError):
            load_fmu(packed(OTHER, {"../evil.txt": b"x"}))
        assert list(kept.rglob("evil*")) == []

    def test_name_a_link_in_the_archive(self, packed: Callable[..., Path]) -> None:
        path = packed(OTHER)
        with zipfile.ZipFile(path, "a") as archive:
            entry = zipfile.ZipInfo("resources/link")
            entry.external_attr = 0o120777 << 16
            archive.writestr(entry, "/etc")
        with pytest.raises(ModelError, match="its entry 'resources/link' leads out"):
            load_fmu(path)

    @pytest.mark.parametrize("keep", [0, 10, 1000, -1])
    def test_name_a_file_that_is_cut_off(self, keep: int, packed: Callable[..., Path]) -> None:
        path = packed(OTHER)
        path.write_bytes(path.read_bytes()[:keep])
        with pytest.raises(ModelError, match=r"FMU .*tiny\.fmu is broken: .*; export or copy it again"):
            load_fmu(path)

    def test_name_a_damaged_entry(self, packed: Callable[..., Path]) -> None:
        path = packed(OTHER)
        content = bytearray(path.read_bytes())
        content[200:260] = bytes(60)
        path.write_bytes(content)
        with pytest.raises(ModelError, match="is broken: "):
            load_fmu(path)

    def test_name_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(ModelError, match=r"cannot read the FMU .*none\.fmu: No such file"):
            load_fmu(tmp_path / "none.fmu")

    def test_name_an_archive_that_is_too_large(
        self, packed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(load, "LARGEST_BYTES", 1000)
        with pytest.raises(ModelError, match=r"it unpacks to .* bytes; at most 1000 are taken"):
            load_fmu(packed(OTHER, {"resources/more.txt": b"large"}))

    def test_name_a_function_that_is_missing(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        library = compile_model(OTHER, tmp_path / "cut" / "tiny.so", "-DINCOMPLETE")
        with pytest.raises(ModelError, match="its library lacks the function fmi2FreeInstance"):
            load_fmu(packed(OTHER, {"binaries/linux64/tiny.so": library.read_bytes()}))

    @pytest.mark.parametrize("keep", [40, 200, 5000])
    def test_name_a_library_that_is_cut_off(self, keep: int, packed: Callable[..., Path]) -> None:
        library = entries(OTHER)["binaries/linux64/tiny.so"][:keep]
        with pytest.raises(ModelError, match=r"is broken: its library tiny\.so is cut off; export it again"):
            load_fmu(packed(OTHER, {"binaries/linux64/tiny.so": library}))

    def test_name_a_library_that_does_not_load(self, packed: Callable[..., Path], tmp_path: Path) -> None:
        library = compile_model(OTHER, tmp_path / "lacking" / "tiny.so", "-DRATE_OF_TIME=nowhere_to_be_found")
        with pytest.raises(ModelError, match=r"its library does not load: .*nowhere_to_be_found"):
            load_fmu(packed(OTHER, {"binaries/linux64/tiny.so": library.read_bytes()}))

    def test_report_a_missing_compiler(self, packed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("CC", "no-such-compiler")
        with pytest.raises(
            ModelError, match="there is no compiler no-such-compiler, which the variable CC names: install it"
        ):
            load_fmu(packed(OTHER))

    def test_meet_values_that_are_not_finite(self, packed: Callable[..., Path]) -> None:
        with pytest.raises(ModelError, match=r"'Controller\.gain' cannot be nan"):
            load_fmu(packed(OTHER)).write("Controller.gain", math.nan)
