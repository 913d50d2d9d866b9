# SPDX-License-Identifier: MIT
"""What code that 20-sim generated is made of, found by reading it: nothing here knows a prefix or a file name.

Sources: the code itself, as 20-sim 4.5 to 5.1 generates it from its C and C++ templates. Entry points are found by what
their names end or begin with (`<prefix>CalculateSubmodel`), arrays by their letter behind the prefix of variables
(`<prefix>P` parameters, `s` states, `R` rates or next states, `V` variables, `I` initial values, `M` matrices).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.library import Flavour
from segway_ecc.node.native.twenty_sim.files import CPP_SUFFIXES, Folder, Function, SourceFile, comment_at

METHODS: Final = ("Discrete", "Euler", "RungeKutta2", "RungeKutta4")
SECTIONS: Final = ("Initial", "Static", "Input", "Dynamic", "Output", "Final")
_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PREFIXED: Final = (
    r"(?<!\w)(\w*?)step_size\s*=(?!=)",
    r"(?<!\w)(\w*?)s\s*\[\s*\d+\s*\]\s*=(?!=)",
    r"(\w*_)V\s*\[",
)
_TYPEDEF: Final = re.compile(r"\btypedef\s+((?:const\s+)?(?:unsigned\s+)?\w+\s*\**)\s*(\w+)\s*;")


class Symbol(NamedTuple):
    """A global variable of the code, with its C type as the code names it; a pointer is to the first element."""

    kind: str
    is_pointer: bool
    is_array: bool


class Element(NamedTuple):
    """One element of an array, as the code sets it: the value as it is written, and the comment behind it."""

    value: str
    comment: str


@dataclass(frozen=True)
class Parts:
    """The parts of a generated model; each is read from the files when it is first asked for.

    Attributes:
        model: The file with the equations.
        owner: The C++ class; empty in C.
    """

    folder: Folder
    model: SourceFile
    owner: str

    @property
    def is_cpp(self) -> bool:
        """Whether the file with the equations is compiled as C++."""
        return self.model.suffix in CPP_SUFFIXES

    @cached_property
    def flavour(self) -> Flavour:
        """Which shape."""
        if self.owner:
            return Flavour.CPP_CLASS
        is_whole = {"InitializeSubmodel", "CalculateSubmodel"} <= self.functions.keys()
        return Flavour.C_SUBMODEL if is_whole else Flavour.C_PARTIAL

    @property
    def name(self) -> str:
        """The submodel's name."""
        fields = self.model.fields
        return self.owner or fields.get("subm") or fields.get("model") or self.folder.path.resolve().name

    @property
    def build(self) -> str:
        """What generated it; empty where it is not known."""
        fields = next((file.fields for file in self.folder.sources if file.fields.get("build")), {})
        build = f"20-sim {fields['build']}" if fields else ""
        return f"{build}, {fields['date']}" if fields.get("date") else build

    @cached_property
    def functions(self) -> dict[str, Function]:
        """Every function of the code that matters, by its role, such as "CalculateDynamic"."""
        found: dict[str, Function] = {}
        for source in self.folder.sources:
            for name, function in source.functions.items():
                if name.rpartition("::")[0] == self.owner and (role := _role(name)):
                    found.setdefault(role, function)
        return found

    @cached_property
    def prefix(self) -> str:
        """What the names of variables begin with, such as `xx_`.

        Raises:
            ModelError: The code sets none of the variables that show it.
        """
        for pattern in _PREFIXED:
            for source in (self.model, *self.folder.sources):
                if match := re.search(pattern, source.code):
                    return match[1]
        text = f"cannot find what the variables in {self.model.name} begin with: it sets neither step size nor states"
        raise ModelError(text)

    @cached_property
    def symbols(self) -> dict[str, Symbol]:
        """Global variables, by name without the prefix."""
        pattern = re.compile(
            rf"^[ \t]*(\w+)\s*(\*?)\s*{re.escape(self.prefix)}(\w+)\s*(\[[^\]]*\])?\s*(?:=[^;]*)?;", re.MULTILINE
        )
        return {
            match[3]: Symbol(match[1], bool(match[2]), bool(match[4]))
            for source in self.folder.sources
            for match in pattern.finditer(source.code)
            if match[1] not in ("extern", "static", "return")
        }

    @cached_property
    def types(self) -> dict[str, str]:
        """What each typedef stands for."""
        every = (*self.folder.headers, *self.folder.sources)
        return {match[2]: match[1].strip() for file in every for match in _TYPEDEF.finditer(file.code)}

    @cached_property
    def real(self) -> str:
        """The C type behind XXDouble: "double" or "float".

        Raises:
            ModelError: It is another.
        """
        kind = next((base for name, base in self.types.items() if name.endswith("Double")), "double")
        kind = self.types.get(kind, kind)
        if kind not in ("double", "float"):
            raise ModelError(f"the code computes with numbers of type '{kind}'; only double and float can be used")
        return kind

    def sections(self) -> dict[str, str]:
        """The equations of each section, comments blanked."""
        return {
            name: self.functions[role].body if (role := f"Calculate{name}") in self.functions else ""
            for name in SECTIONS
        }

    def elements(self, letter: str) -> list[Element]:
        """The elements of an array in order, as the code first sets them."""
        text, code = self.model.text, self.model.code
        target = re.escape(f"{self.prefix}{letter}")
        found: dict[int, Element] = {}
        for match in re.finditer(rf"(?<![\w.]){target}\s*\[\s*(\d+)\s*\]\s*=(?!=)([^;]*);", code):
            value = text[match.start(2) : match.end(2)].strip()
            found.setdefault(int(match[1]), Element(value, comment_at(text, match.end())))
        return [found.get(index, Element("", "")) for index in range(max(found, default=-1) + 1)]


def find_parts(folder: Folder) -> Parts:
    """Find the parts of the model in a folder.

    Raises:
        ModelError: There is no model among the files, there are several, or one cannot be followed.
    """
    models = {file: name for file in folder.sources for name in file.functions if _role(name) == "CalculateDynamic"}
    if not models:
        raise ModelError(f"{folder.path} holds no model: none of its C or C++ files has dynamic equations")
    if len(models) > 1:
        names = ", ".join(source.name for source in models)
        raise ModelError(f"{folder.path} holds {len(models)} models ({names}): give the folder of one of them")
    ((model, name),) = models.items()
    parts = Parts(folder, model, name.rpartition("::")[0])
    _ = parts.prefix, parts.real  # here, so that what cannot be followed is refused here
    return parts


def number(text: str, names: Mapping[str, float] | None = None) -> float | None:
    """Return the value of a literal, or of a name that is known; None for anything else."""
    plain = text.strip()
    if re.fullmatch(_NUMBER, plain):
        return float(plain)
    if re.fullmatch(r"\w*TRUE|true", plain):
        return 1.0
    if re.fullmatch(r"\w*FALSE|false", plain):
        return 0.0
    return (names or {}).get(re.sub(r"\s", "", plain))


def setting(parts: Parts, name: str) -> float | None:
    """Return a number that the code gives to one of its variables, such as `step_size`; None where it gives none."""
    pattern = re.compile(rf"(?<!\w){re.escape(parts.prefix + name)}\s*=\s*({_NUMBER})\s*;")
    for source in (parts.model, *parts.folder.sources):
        if match := pattern.search(source.code):
            return float(match[1])
    return None


def find_method(parts: Parts) -> str:
    """Return the integration method that the code names; empty where it names none."""
    texts = [source.code for source in (*parts.folder.headers, *parts.folder.sources)]
    step = parts.functions.get("CalculateSubmodel")
    patterns = [(r"\b(\w+)\s+\w*integmethod\s*;", texts), (r"^\s*#\s*define\s+(\w+)_METHOD\b", texts)]
    if step is not None:
        prefix = re.escape(step.name.partition("CalculateSubmodel")[0])
        patterns.insert(0, (rf"\b{prefix}(\w+)Step\s*\(", [step.body]))
    for pattern, places in patterns:
        for text in places:
            if match := re.search(pattern, text, re.MULTILINE):
                return match[1]
    return ""


_ROLES: Final = (
    *(f"Calculate{section}" for section in SECTIONS),
    *("InitializeSubmodel", "CalculateSubmodel", "TerminateSubmodel", "ModelInitialize", "ModelTerminate"),
    *("CopyInputsToVariables", "CopyVariablesToOutputs"),
)
_CLASS_ROLES: Final = ("Initialize", "Calculate", "Terminate", "SetFinishTime")
_METHOD_ROLE: Final = re.compile(rf"({'|'.join(METHODS)})(Initialize|Step)$")


def _role(name: str) -> str:
    """The part a function plays, by what is left of its name beside the user's prefix or suffix."""
    owner, _, plain = name.rpartition("::")
    if owner and plain in _CLASS_ROLES:
        return plain
    if not owner and (match := _METHOD_ROLE.search(name)):
        return match[0]
    return next((role for role in _ROLES if role in plain), "")
