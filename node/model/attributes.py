# SPDX-License-Identifier: MIT
"""The attributes of an object of any class, compiled or not: what captures a state or takes a write back goes by."""

import enum
import types
from collections.abc import Set as AbstractSet
from functools import lru_cache
from typing import Any, Final

import msgspec

from segway_ecc.firmware_io.value import Section

CODE: Final = (types.FunctionType, types.BuiltinFunctionType, types.MethodType, type)
_CLASSES_KEPT: Final = 256
_HEAP_TYPE: Final = 1 << 9
"""From CPython's object.h: a type that is not built into the interpreter."""
_values: Final[dict[type, bool]] = {}


def path_of(kind: type) -> str:
    """The module and the name of a class."""
    return f"{kind.__module__}:{kind.__qualname__}"


def is_value(kind: type) -> bool:
    """Whether it is made of its fields and never changed, which msgspec writes and reads."""
    if kind not in _values:
        is_frozen: bool = getattr(getattr(kind, "__dataclass_params__", None), "frozen", False)
        is_record = issubclass(kind, tuple) and hasattr(kind, "_fields")
        is_struct = issubclass(kind, (msgspec.Struct, enum.Enum)) and not issubclass(kind, Section)
        _values[kind] = is_record or is_struct or is_frozen
    return _values[kind]


def attributes_of(value: Any, outside: AbstractSet[str] = frozenset()) -> list[str]:  # noqa: ANN401 - of any class
    """The names of the attributes that it has, in an order that does not depend on how it was compiled."""
    own = tuple(getattr(value, "__dict__", ()))
    names = _ordered(type(value), own)  # type: ignore[arg-type]  # mypy does not see that a class can be hashed
    return [name for name in names if name not in outside and hasattr(value, name)]


@lru_cache(maxsize=_CLASSES_KEPT)
def _ordered(kind: type[Any], own: tuple[str, ...]) -> tuple[str, ...]:
    """Those that a class declares, and an object's `own`; put in order once for all objects that have the same."""
    return tuple(sorted({*_declared(kind), *own}, key=lambda name: (name[0] == "_", name)))


def _declared(kind: type) -> list[str]:
    """The attributes that a class declares, itself or by its bases.

    Raises:
        TypeError: It holds something else besides, as the classes of other libraries may.
    """
    root = kind
    while root.__flags__ & _HEAP_TYPE and root.__base__ is not None:
        root = root.__base__
    names: list[str] = []
    for each in kind.__mro__:
        slots = vars(each).get("__mypyc_attrs__", vars(each).get("__slots__", ()))
        names += (slots,) if isinstance(slots, str) else slots
    is_plain = all(getattr(kind, name) is getattr(object, name) for name in ("__reduce__", "__reduce_ex__"))
    if root is not object or not is_plain or not (names or kind.__dictoffset__):
        raise TypeError(f"{path_of(kind)} cannot be captured")
    return [name for name in names if not name.startswith("__")]
