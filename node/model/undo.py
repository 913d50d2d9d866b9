# SPDX-License-Identifier: MIT
"""A model put back to what it was: by its own `save_state` and `restore_state`, or by the contents of its objects."""

import types
from collections import Counter, defaultdict, deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from segway_ecc.node.model.attributes import attributes_of, is_value, path_of
from segway_ecc.node.model.model import Model, unwrapped

MOST_VALUES: Final = 5_000
"""So many are kept in a millisecond or two."""
_PLAIN: Final = frozenset({type(None), bool, int, float, complex, str, bytes})
_CODE: Final = (types.FunctionType, types.BuiltinFunctionType, type, types.ModuleType)
_NUMBERS: Final = frozenset("?bBhHiIlLqQefd")
"""What numbers an array may hold, by the format of its memory; objects are none."""
_SEQUENCES: Final = frozenset({list, deque})
_TABLES: Final = frozenset({dict, defaultdict, Counter})
_LARGEST_BUFFER: Final = 4 << 20
"""Of all arrays together, bytes: some tenths of a millisecond."""
_ABSENT: Final = object()


def keep_state(model: Model) -> Callable[[], None]:
    """Keep what a model is now; what it returns puts that back, as often as it is called.

    Raises:
        Exception: The state cannot be kept; the text names what of it. A model's own `save_state` may raise anything.
    """
    keep = getattr(model, "keep_in_process", None)  # of an FMU
    if keep is not None:
        put_back: Callable[[], None] = keep()
        return put_back
    save = getattr(model, "save_state", None)
    if save is not None:
        return partial(model.restore_state, save())  # type: ignore[attr-defined]  # who gives it takes it
    return _Kept(unwrapped(model)).put_back


class _Kept:
    """The contents of an object and of all that it holds.

    Raises:
        TypeError: It holds something whose contents cannot be seen.
        ValueError: It holds too much.
    """

    def __init__(self, root: object) -> None:
        self._contents: list[tuple[Any, Any]] = []
        self._met: set[int] = set()
        self._count = 0
        self._bytes = 0
        self._keep(root)

    def put_back(self) -> None:
        """Make every object what it was."""
        for place, content in self._contents:
            kind = type(place)
            if kind in _SEQUENCES:
                place.clear()
                place.extend(content)
            elif isinstance(content, bytes):
                memoryview(place).cast("B")[:] = content
            elif kind in _TABLES or kind is set:
                place.clear()
                place.update(content)
            else:
                _put_attributes(place, content)

    def _keep(self, value: Any) -> None:  # noqa: ANN401 - whatever a model holds
        kind = type(value)
        if kind in _PLAIN or is_value(kind) or id(value) in self._met or _is_code(value):
            return
        if kind in {tuple, frozenset, types.MethodType}:
            self._keep_all((value.__self__,) if kind is types.MethodType else value)
            return
        self._met.add(id(value))
        buffer = _buffer_of(value)
        if buffer is not None:
            self._bytes += buffer.nbytes
            if self._bytes > _LARGEST_BUFFER:
                raise ValueError(f"its arrays take more than {_LARGEST_BUFFER} bytes")
            self._contents.append((value, buffer.tobytes()))
            return
        if kind in _SEQUENCES:
            content: Any = list(value)
        elif kind is set:
            content = set(value)
        elif kind in _TABLES:
            content = dict(value)
        else:
            content = {name: getattr(value, name) for name in attributes_of(value)}
        self._contents.append((value, content))
        self._keep_all(content.values() if isinstance(content, dict) else content)

    def _keep_all(self, values: Any) -> None:  # noqa: ANN401 - as above
        self._count += len(values)
        if self._count > MOST_VALUES:
            raise ValueError(f"it holds more than {MOST_VALUES} values")
        for value in values:
            self._keep(value)


def _is_code(value: object) -> bool:
    """Whether it is code without anything of its own."""
    if isinstance(value, types.FunctionType) and value.__closure__ is not None:
        raise TypeError(f"{path_of(type(value))} '{value.__name__}' holds variables of its own")
    return isinstance(value, _CODE) or "__mypyc_lambda" in type(value).__name__


def _buffer_of(value: Any) -> memoryview | None:  # noqa: ANN401 - of any class
    """The memory of an array of numbers, such as numpy's; None where it is none, or not in one piece."""
    try:
        view = memoryview(value)
    except TypeError:
        return None
    is_plain = view.c_contiguous and view.format in _NUMBERS
    return view if is_plain else None


def _put_attributes(place: object, content: dict[str, Any]) -> None:
    for name in attributes_of(place):
        if name not in content:
            delattr(place, name)
    for name, value in content.items():
        if getattr(place, name, _ABSENT) is not value:
            setattr(place, name, value)
