# SPDX-License-Identifier: MIT
"""What an FMU's modelDescription.xml holds, in one shape for FMI 2.0 and 3.0; and its XML files, read with care.

Sources: FMI 2.0.4, sections 2.2 and 4.3.1; FMI 3.0.1, sections 2.4 and 4.4.
"""

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from segway_ecc.node.errors import ModelError


class _NoDoctype(ET.TreeBuilder):
    """Builds the tree, and stops at a DOCTYPE, before any entity in it can expand."""

    def doctype(self, _name: str, _pubid: str | None, _system: str | None) -> None:
        """Refuse it: raises ModelError."""
        raise ModelError("it has a DOCTYPE, which no FMU needs")


def parse_xml(content: bytes, where: str) -> ET.Element:
    """Parse an XML document in the encoding it declares; `where` is its name, for messages.

    Raises:
        ModelError: It is not well-formed, or has a DOCTYPE.
    """
    parser = ET.XMLParser(target=_NoDoctype())  # noqa: S314 - as above
    try:
        parser.feed(content)
        return parser.close()
    except ModelError as error:
        raise ModelError(f"{where} is refused: {error}; export it again") from None
    except (ET.ParseError, LookupError, ValueError) as error:
        raise ModelError(f"{where} is not well-formed XML: {error}; export it again") from error


def read_xml(path: Path, where: str) -> ET.Element:
    """Parse an XML file; see `parse_xml`.

    Raises:
        ModelError: It cannot be read, is not well-formed, or has a DOCTYPE.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{where} cannot be read: {error.strerror or error}; export the FMU again") from error
    return parse_xml(content, where)


def flag(element: ET.Element, attribute: str) -> bool:
    """Whether a boolean attribute is set; both spellings of XML Schema count."""
    return element.get(attribute, "false").strip() in ("true", "1")


def number(text: str | None, what: str) -> float | None:
    """Return a finite number, or None for no text.

    Raises:
        ModelError: The text is no finite number; the message begins with `what`.
    """
    if text is None or not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ModelError(f"{what} is '{text}', which is no finite number; correct the model and export it again")
    return value


DESCRIPTION: Final = "modelDescription.xml"
_LARGEST_REFERENCE: Final = 2**32 - 1
_REAL: Final = ("Real", "Float64")
"""Elements of numbers in double precision, in FMI 2.0 and 3.0."""


@enum.unique
class Causality(enum.StrEnum):
    """What a variable is to those outside; under the names of the standard."""

    INPUT = "input"
    OUTPUT = "output"
    PARAMETER = "parameter"
    CALCULATED_PARAMETER = "calculatedParameter"
    STRUCTURAL_PARAMETER = "structuralParameter"
    LOCAL = "local"
    INDEPENDENT = "independent"


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """One variable as the file declares it.

    Attributes:
        name: With `.` for the hierarchy.
        variability: When it may change, under the standard's names.
        initial: How its start value is found, under the standard's names; empty where the file leaves it open.
        type: The element that gives its type; "Real" and "Float64" are double precision.
        unit: Unit as given; empty for none.
        start: Start value, in `unit`; None where it is given none.
        minimum, maximum: Its range, in `unit`; None where it is given none.
        derivative: In FMI 2.0 the place (from 1), in FMI 3.0 the reference, of what it is the derivative of.
        array: It has dimensions.
    """

    name: str
    reference: int
    causality: Causality
    variability: str
    initial: str
    type: str
    unit: str
    start: float | None
    minimum: float | None
    maximum: float | None
    derivative: int | None
    array: bool

    @property
    def is_real(self) -> bool:
        """Whether it is one number in double precision."""
        return self.type in _REAL and not self.array


@dataclass(frozen=True, slots=True)
class Facts:
    """An FMU's own account of itself.

    Attributes:
        version: Major version of FMI: 2 or 3.
        identifier: Base name of its libraries.
        token: Its guid or instantiationToken.
        tool: What generated it, as it states.
        step_size: Step that the file asks for, s; None where it asks for none.
        stop_time: End of its experiment, s; None where there is none.
        variables: All its variables, in the file's order.
        states: Names of the states that its structure shows.
        variable_steps: It can take steps of any length.
        keeps_state: It can give its state, and take it back, in memory.
    """

    version: int
    name: str
    identifier: str
    token: str
    tool: str
    step_size: float | None
    stop_time: float | None
    variables: tuple[FmuVariable, ...]
    states: tuple[str, ...]
    variable_steps: bool
    keeps_state: bool


def read_facts(folder: Path, path: Path) -> Facts:
    """Read the description of an FMU that is unpacked in `folder`; messages call it `path`.

    Raises:
        ModelError: The description is missing or wrong, or of a kind of FMU that cannot run here; the text names it.
    """
    if not (folder / DESCRIPTION).is_file():
        raise ModelError(f"{path} is no FMU: it has no {DESCRIPTION}")
    where = f"{DESCRIPTION} of FMU {path}"
    root = read_xml(folder / DESCRIPTION, where)
    major = root.get("fmiVersion", "").split(".")[0]
    if root.tag != "fmiModelDescription" or not major:
        raise ModelError(f"{path} is no FMU: its {DESCRIPTION} does not begin with fmiModelDescription and its version")
    if major not in ("2", "3"):
        raise ModelError(
            f"FMU {path} is FMI {root.get('fmiVersion')}; FMI 2.0 and 3.0 are taken: export it again as one of them"
        )
    version = int(major)
    interface = _co_simulation(root, path)
    experiment = root.find("DefaultExperiment")
    asked = {} if experiment is None else experiment.attrib
    variables = tuple(_variables(root, where, version))
    return Facts(
        version=version,
        name=root.get("modelName", "") or interface.get("modelIdentifier", ""),
        identifier=interface.get("modelIdentifier", ""),
        token=root.get("guid" if version == 2 else "instantiationToken", ""),  # noqa: PLR2004 - the standard's number
        tool=root.get("generationTool", ""),
        step_size=number(asked.get("stepSize") or interface.get("fixedInternalStepSize"), f"stepSize in {where}"),
        stop_time=number(asked.get("stopTime"), f"stopTime in {where}"),
        variables=variables,
        states=tuple(_states(root, variables)),
        variable_steps=flag(interface, "canHandleVariableCommunicationStepSize"),
        keeps_state=flag(interface, "canGetAndSetFMUstate" if version == 2 else "canGetAndSetFMUState"),  # noqa: PLR2004 - as above
    )


def _co_simulation(root: ET.Element, path: Path) -> ET.Element:
    interface = root.find("CoSimulation")
    if interface is None:
        kinds = [kind for kind in ("ModelExchange", "ScheduledExecution") if root.find(kind) is not None]
        raise ModelError(
            f"FMU {path} is for {' and '.join(kinds) or 'nothing'} only and brings no solver that steps it: "
            "export it again for co-simulation"
        )
    if flag(interface, "needsExecutionTool"):
        raise ModelError(
            f"FMU {path} needs {root.get('generationTool') or 'the tool that exported it'} running beside it "
            "(needsExecutionTool): export it again as a stand-alone FMU"
        )
    identifier = interface.get("modelIdentifier", "")
    if not identifier or "/" in identifier or identifier.startswith("."):
        raise ModelError(f"FMU {path} has the modelIdentifier '{identifier}', which names no library: export it again")
    return interface


def _variables(root: ET.Element, where: str, version: int) -> Iterator[FmuVariable]:
    # What a type gives stands on it in FMI 3.0, on its child in FMI 2.0.
    types = {
        definition.get("name"): {key: value for each in (definition, *definition) for key, value in each.items()}
        for definition in root.iterfind("TypeDefinitions/*")
    }
    for element in root.iterfind("ModelVariables/*"):
        what = f"variable '{element.get('name', '')}' in {where}"
        typed = element
        if version == 2:  # noqa: PLR2004 - the standard's number
            typed = next((child for child in element if child.tag != "Annotations"), element)
        causality = element.get("causality", Causality.LOCAL)
        if causality not in tuple(Causality):
            raise ModelError(f"causality of {what} is '{causality}', which the standard does not know: export it again")
        real = typed.tag in _REAL
        given = {**types.get(typed.get("declaredType"), {}), **typed.attrib}
        array = element.find("Dimension") is not None
        derivative = typed.get("derivative")
        yield FmuVariable(
            name=element.get("name", ""),
            reference=_natural(element.get("valueReference"), f"valueReference of {what}"),
            causality=Causality(causality),
            variability=element.get("variability", "continuous" if real else "discrete"),
            initial=element.get("initial", ""),
            type=typed.tag,
            unit=given.get("unit", ""),
            start=number(typed.get("start"), f"start of {what}") if real and not array else None,
            minimum=number(given.get("min"), f"min of {what}") if real and not array else None,
            maximum=number(given.get("max"), f"max of {what}") if real and not array else None,
            derivative=_natural(derivative, f"derivative of {what}") if derivative else None,
            array=array,
        )


def _natural(text: str | None, what: str) -> int:
    cleaned = (text or "").strip()
    if not (cleaned.isascii() and cleaned.isdigit() and int(cleaned) <= _LARGEST_REFERENCE):
        raise ModelError(f"{what} is '{cleaned}', which is no number from 0 to {_LARGEST_REFERENCE}: export it again")
    return int(cleaned)


def _states(root: ET.Element, variables: tuple[FmuVariable, ...]) -> Iterator[str]:
    """Names of the states: what the derivatives in ModelStructure are derivatives of."""
    places = {str(place): variable for place, variable in enumerate(variables, start=1)}
    references = {str(variable.reference): variable for variable in variables if variable.derivative is not None}
    reals = {variable.reference: variable.name for variable in reversed(variables) if variable.is_real}
    for unknown in root.iterfind("ModelStructure/Derivatives/Unknown"):
        derivative = places.get(unknown.get("index", ""))
        state = places.get(str(derivative.derivative)) if derivative is not None else None
        if state is not None and state.is_real:
            yield state.name
    for unknown in root.iterfind("ModelStructure/ContinuousStateDerivative"):
        derivative = references.get(unknown.get("valueReference", ""))
        if derivative is not None and derivative.derivative in reals:
            yield reals[derivative.derivative]
