# SPDX-License-Identifier: MIT
"""The XML files of an FMU, read with care: they come from anywhere."""

import math
from pathlib import Path
from xml.etree import ElementTree as ET

from segway_ecc.node.errors import ModelError


class _NoDoctype(ET.TreeBuilder):
    """Builds the tree, and stops at a DOCTYPE, before any entity in it can expand."""

    def doctype(self, _name: str, _pubid: str | None, _system: str | None) -> None:
        """Refuse it.

        Raises:
            ModelError: Always.
        """
        raise ModelError("it has a DOCTYPE, which no FMU needs")


def parse_xml(content: bytes, where: str) -> ET.Element:
    """Parse an XML document in the encoding it declares.

    Args:
        content: The document.
        where: Its name, for messages.

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
