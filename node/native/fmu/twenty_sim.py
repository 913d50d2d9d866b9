r"""What 20-sim puts into its FMUs beyond the standard: model configuration, tokens, static equations.

Sources: the open export template of Controllab (fmi-export-20sim), which shows that the model description is made from
`ModelConfiguration.xml` (`run/stepSize`, `modelVariable/name`, `kind`, `unit`, `storage`), with `.` for `\`.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from segway_ecc.node.native.fmu.xml import number, parse_xml, read_xml

_SECTION: Final = re.compile(
    r"^void\s+\w*Calculate(Initial|Static|Input|Dynamic|Output)\s*\([^)]*\)\s*\{(.*?)^\}", re.MULTILINE | re.DOTALL
)
SECTIONS: Final = ("Initial", "Static", "Input", "Dynamic", "Output")
"""The sections of equations, in the order in which a model runs them when it starts."""

_NAMED: Final = re.compile(r"(\w*P)\s*\[\s*(\d+)\s*\]\s*=[^;]*;\s*/\*\s*(.*?)\s*\*/")
_USED: Final = re.compile(r"(\w*P)\s*\[\s*(\d+)\s*\]")
_METHOD: Final = re.compile(r"\b[A-Z]\w*?(Discrete|Euler|RungeKutta2|RungeKutta4|VodeAdams|MeBDFi)Step\b")
_DECLARATION: Final = re.compile(r"^\s*<\?xml[^>]*\?>")
_NUMBER: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_UNIT: Final = re.compile(r"\s*\{[^{}]*\}$")


@dataclass(frozen=True, slots=True)
class TwentySim:
    """What is known of an FMU that 20-sim exported.

    Attributes:
        globals: It keeps its values in globals, one model in a process: exports before August 2016.
        restart_symbols: The functions that run its sections, in the order of `SECTIONS`; empty unless it keeps its
            values in globals and exports all of them.
        starting_symbol: The flag by which its equations know that they start; None where it does not export one.
        static_symbol: The function that runs its static equations; None where it does not export one.
        stop_symbol: The flag by which the model stops itself; None where it does not export one.
        updates_itself: It runs its static equations by itself after a parameter is written.
        step_size: Step of its experiment, s; None where it does not say.
        method: Integration method, under 20-sim's name; empty where it does not say.
        states: Names of its states, with `.` for the hierarchy.
        units: Units by name.
        values: Values at the start by name, in those units.
        sections: By parameter's name, the sections that use it ("Initial", "Static", ...); no entry where not known.
    """

    globals: bool
    restart_symbols: tuple[str, ...]
    starting_symbol: str | None
    static_symbol: str | None
    stop_symbol: str | None
    updates_itself: bool
    step_size: float | None
    method: str
    states: tuple[str, ...]
    units: dict[str, str]
    values: dict[str, float]
    sections: dict[str, frozenset[str]]


def read_twenty_sim(folder: Path, tool: str, symbols: frozenset[str]) -> TwentySim | None:
    """Return what an unpacked FMU holds of 20-sim; None where another tool made it.

    Args:
        folder: Where it is unpacked.
        tool: What generated it, as it says itself.
        symbols: The names that its library exports.

    Raises:
        ModelError: One of 20-sim's XML files in it is not well-formed.
    """
    configuration, tokens = _configuration(folder), _tokens(folder)
    if configuration is None and "MODEL_CONFIGURATION" in tokens:
        configuration = _embedded(tokens["MODEL_CONFIGURATION"])
    if configuration is None and "20-sim" not in tool.lower():
        return None
    code = _code(folder)
    in_globals = any(symbol.endswith("MEMORY") for symbol in symbols)
    return TwentySim(
        globals=in_globals,
        restart_symbols=_restart(symbols) if in_globals else (),
        starting_symbol=_ending(symbols, "_initialize"),
        static_symbol=_ending(symbols, "CalculateStatic"),
        stop_symbol=_ending(symbols, "stop_simulation"),
        updates_itself="parameters_updated" in code,
        step_size=_step_size(folder, configuration, tokens),
        method=_method(code, tokens),
        states=tuple(_states(configuration)),
        units=dict(_units(configuration)),
        values=dict(_values(configuration)),
        sections=_sections(code, tokens),
    )


def _embedded(text: str) -> ET.Element:
    # Its own declaration of an encoding went out of date when the text was put into another file.
    return parse_xml(_DECLARATION.sub("", text).encode(), "the model configuration in tokens.xml")


def _ending(symbols: frozenset[str], ending: str) -> str | None:
    return min((symbol for symbol in symbols if symbol.endswith(ending)), key=len, default=None)


def _restart(symbols: frozenset[str]) -> tuple[str, ...]:
    found = [symbol for section in SECTIONS if (symbol := _ending(symbols, f"Calculate{section}")) is not None]
    return tuple(found) if len(found) == len(SECTIONS) else ()


def _named(folder: Path, name: str) -> Path | None:
    return next((file for file in sorted(folder.rglob("*.xml")) if file.name.lower() == name), None)


def _configuration(folder: Path) -> ET.Element | None:
    file = _named(folder, "modelconfiguration.xml")
    return None if file is None else read_xml(file, file.name)


def _tokens(folder: Path) -> dict[str, str]:
    file = _named(folder, "tokens.xml")
    if file is None:
        return {}
    return {token.get("name", ""): _inside(token) for token in read_xml(file, file.name).iterfind("token")}


def _inside(token: ET.Element) -> str:
    """A token's text; one that holds XML may hold it as elements."""
    return "".join([token.text or "", *(ET.tostring(child, encoding="unicode") for child in token)]).strip()


def _code(folder: Path) -> str:
    # Comments may be in any of two encodings; both keep ASCII, and latin-1 reads every byte.
    files = sorted((folder / "sources").rglob("*.c"))
    own = (file for file in files if file.name.endswith(("model.c", "submod.c", "Functions.c")))
    return "\n".join(_decoded(file.read_bytes()) for file in own).replace("\r\n", "\n")


def _decoded(content: bytes) -> str:
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _step_size(folder: Path, configuration: ET.Element | None, tokens: dict[str, str]) -> float | None:
    given = None if configuration is None else configuration.findtext("run/stepSize")
    annotated = next(_annotated(read_xml(folder / "modelDescription.xml", "modelDescription.xml")), None)
    return number(given or annotated or tokens.get("TIME_STEP_SIZE"), "the step size in 20-sim's own files")


def _annotated(root: ET.Element) -> Iterator[str]:
    for tool in root.iterfind("VendorAnnotations/Tool"):
        if "20-sim" in tool.get("name", "").lower():
            yield from (step for element in tool.iter() if (step := element.get("stepSize", "")))
            yield from (element.text or "" for element in tool.iter("stepSize"))


def _method(code: str, tokens: dict[str, str]) -> str:
    found = _METHOD.search(code)
    return found.group(1) if found else tokens.get("INTEGRATION_METHOD_NAME", "")


def _variables(configuration: ET.Element | None) -> Iterator[tuple[str, ET.Element]]:
    if configuration is not None:
        for variable in configuration.iterfind("modelVariables/modelVariable"):
            yield dotted(variable.findtext("name", "")), variable


def _states(configuration: ET.Element | None) -> Iterator[str]:
    for name, variable in _variables(configuration):
        stored = variable.findtext("storage/name", "")
        if variable.findtext("kind", "") == "state" or stored.endswith("_s"):
            yield name


def _units(configuration: ET.Element | None) -> Iterator[tuple[str, str]]:
    for name, variable in _variables(configuration):
        unit = (variable.findtext("unit") or variable.findtext("unit/symbol") or "").strip()
        if unit:
            yield name, unit


def _values(configuration: ET.Element | None) -> Iterator[tuple[str, float]]:
    for name, variable in _variables(configuration):
        text = variable.findtext("value", "").strip()
        # A vector's values stand in one text, which no state of one element needs.
        if _NUMBER.fullmatch(text):
            yield name, float(text)


def _sections(code: str, tokens: dict[str, str]) -> dict[str, frozenset[str]]:
    bodies = dict(_SECTION.findall(code)) or {
        section: tokens[f"{section.upper()}_EQUATIONS"]
        for section in SECTIONS
        if f"{section.upper()}_EQUATIONS" in tokens
    }
    if not bodies:
        return {}
    used = {section: set(_USED.findall(body)) for section, body in bodies.items()}
    named = _NAMED.findall(code) or _NAMED.findall(tokens.get("INITIALIZE_PARAMETERS", ""))
    return {
        dotted(_UNIT.sub("", comment)): frozenset(section for section in used if (array, place) in used[section])
        for array, place, comment in named
    }


def dotted(name: str) -> str:
    """20-sim's name as the model description spells it."""
    return name.strip().replace("\\", ".")
