# SPDX-License-Identifier: MIT
r"""What 20-sim puts into its FMUs beyond the standard: model configuration, tokens, static equations.

Sources: the open export template of Controllab (fmi-export-20sim), which shows that the model description is made from
`ModelConfiguration.xml` (`run/stepSize`, `modelVariable/name`, `kind`, `unit`, `storage`), with `.` for `\`.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from segway_ecc.node.native.fmu.facts import number, parse_xml, read_xml
from segway_ecc.node.native.twenty_sim.files import encoding_of

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
_CODE: Final = ("model.c", "submod.c", "Functions.c")
"""How the names of files with equations end."""


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
        step_size: Step of its experiment, s; None where it gives none.
        method: Integration method, under 20-sim's name; empty where it gives none.
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
        tool: What generated it, as it states.
        symbols: The names that its library exports.

    Raises:
        ModelError: One of 20-sim's XML files in it is not well-formed.
    """
    files = {file.name.lower(): file for file in sorted(folder.rglob("*.xml"), reverse=True)}
    tokens = {}
    if file := files.get("tokens.xml"):
        for token in read_xml(file, file.name).iterfind("token"):
            # One that holds XML may hold it as elements.
            inside = [token.text or "", *(ET.tostring(child, encoding="unicode") for child in token)]
            tokens[token.get("name", "")] = "".join(inside).strip()
    configuration = None
    if file := files.get("modelconfiguration.xml"):
        configuration = read_xml(file, file.name)
    elif "MODEL_CONFIGURATION" in tokens:
        # Its own declaration of an encoding went out of date when the text was put into another file.
        text = _DECLARATION.sub("", tokens["MODEL_CONFIGURATION"])
        configuration = parse_xml(text.encode(), "the model configuration in tokens.xml")
    elif "20-sim" not in tool.lower():
        return None
    # Comments may be in any of two encodings; both keep ASCII, and latin-1 reads every byte.
    sources = [file.read_bytes() for file in sorted((folder / "sources").rglob("*.c")) if file.name.endswith(_CODE)]
    code = "\n".join(content.decode(encoding_of(content)) for content in sources).replace("\r\n", "\n")
    in_globals = any(symbol.endswith("MEMORY") for symbol in symbols)
    restart = [symbol for section in SECTIONS if (symbol := _ending(symbols, f"Calculate{section}")) is not None]
    states, units, values = _read_variables(configuration)
    method = _METHOD.search(code)
    return TwentySim(
        globals=in_globals,
        restart_symbols=tuple(restart) if in_globals and len(restart) == len(SECTIONS) else (),
        starting_symbol=_ending(symbols, "_initialize"),
        static_symbol=_ending(symbols, "CalculateStatic"),
        stop_symbol=_ending(symbols, "stop_simulation"),
        updates_itself="parameters_updated" in code,
        step_size=_step_size(folder, configuration, tokens),
        method=method[1] if method else tokens.get("INTEGRATION_METHOD_NAME", ""),
        states=tuple(states),
        units=units,
        values=values,
        sections=_sections(code, tokens),
    )


def _ending(symbols: frozenset[str], ending: str) -> str | None:
    return min((symbol for symbol in symbols if symbol.endswith(ending)), key=len, default=None)


def _step_size(folder: Path, configuration: ET.Element | None, tokens: dict[str, str]) -> float | None:
    found = [] if configuration is None else [configuration.findtext("run/stepSize")]
    root = read_xml(folder / "modelDescription.xml", "modelDescription.xml")
    for tool in root.iterfind("VendorAnnotations/Tool"):
        if "20-sim" in tool.get("name", "").lower():
            found += [element.get("stepSize") for element in tool.iter()]
            found += [element.text for element in tool.iter("stepSize")]
    step = next(filter(None, found), tokens.get("TIME_STEP_SIZE"))
    return number(step, "the step size in 20-sim's own files")


def _read_variables(configuration: ET.Element | None) -> tuple[list[str], dict[str, str], dict[str, float]]:
    """Names of the states, units by name and values by name."""
    states, units, values = list[str](), dict[str, str](), dict[str, float]()
    for variable in () if configuration is None else configuration.iterfind("modelVariables/modelVariable"):
        name = dotted(variable.findtext("name", ""))
        if variable.findtext("kind", "") == "state" or variable.findtext("storage/name", "").endswith("_s"):
            states.append(name)
        if unit := (variable.findtext("unit") or variable.findtext("unit/symbol") or "").strip():
            units[name] = unit
        # A vector's values stand in one text, which no state of one element needs.
        if _NUMBER.fullmatch(text := variable.findtext("value", "").strip()):
            values[name] = float(text)
    return states, units, values


def _sections(code: str, tokens: dict[str, str]) -> dict[str, frozenset[str]]:
    bodies = dict(_SECTION.findall(code)) or {
        section: tokens[token] for section in SECTIONS if (token := f"{section.upper()}_EQUATIONS") in tokens
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
