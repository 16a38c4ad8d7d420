"""Compiled kernels, kept on disk until something that is compiled into them changes.

numba keeps a compiled function until its own file changes, whatever it calls in others: after an
edit or an update of one file, kernels of the others would go on with what they had compiled of it
(numba's manual, "Cache limitations").  Here what goes into a kernel is part of the name under which
it is kept.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from types import CodeType, ModuleType
from typing import Any, TypeVar

import numpy as np
from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

OWN = ("calib", "fe", "surrogate")
"""packages whose kernels may change; those of others come with their version"""


def kernel(**options: Any) -> Callable[[F], F]:
    """Decorator: `numba.njit(cache=True, **options)` that counts what others' code goes into it.

    That is all kernels, constants and named tuples that its module has when it is defined, by
    imports above all, and what theirs have in turn. Of its own file numba knows.
    """

    def compiled(f: F) -> F:
        name = f.__qualname__
        f.__qualname__ = f"{name}_{digest(f, options)}"  # numba names its file by it
        try:
            dispatcher: F = njit(cache=True, **options)(f)
            return dispatcher
        finally:
            f.__qualname__ = name

    return compiled


def digest(f: Callable[..., Any], options: dict[str, Any]) -> str:
    """Twelve hex digits of what may be compiled into a kernel."""
    found = hashlib.sha256()
    for part in (*_code(f, options), *_globals(f.__globals__, {f.__module__})):
        found.update(part.encode() + b"\0")
    return found.hexdigest()[:12]


def _code(f: Any, options: dict[str, Any]) -> Iterator[str]:
    """A function's own code, defaults and options of its compilation."""
    yield f"{f.__module__}.{f.__name__} {f.__defaults__!r} {f.__kwdefaults__!r}"
    for key, value in sorted(options.items()):
        yield f"{key}={sorted(value) if isinstance(value, (set, frozenset)) else value}"
    for code in _codes(f.__code__):
        yield code.co_code.hex()
        yield repr(code.co_names)
        yield repr([const for const in code.co_consts if not isinstance(const, CodeType)])


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of comprehensions and functions in it."""
    yield code
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _codes(const)


def _globals(names: dict[str, Any], seen: set[str]) -> Iterator[str]:
    """What the globals of a module say of the machine code; `seen` are modules that are told."""
    for name, value in sorted(names.items()):
        if not name.startswith("__"):
            yield from _value(name, value, seen)


def _value(name: str, value: Any, seen: set[str]) -> Iterator[str]:
    if hasattr(value, "py_func"):
        f = value.py_func
        yield name
        yield from _code(f, value.targetoptions)
        if f.__module__ not in seen:
            seen.add(f.__module__)
            yield from _globals(f.__globals__, seen)
    elif isinstance(value, (bool, int, float, complex, str, tuple, np.generic)):
        yield f"{name} {type(value).__name__} {value!r}"
    elif isinstance(value, np.ndarray):
        yield f"{name} {value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, type) and hasattr(value, "_fields"):
        yield f"{name} {value._fields}"
    elif isinstance(value, ModuleType) and value.__name__ not in seen:
        seen.add(value.__name__)
        if value.__name__.split(".")[0] in OWN:
            yield from _globals(vars(value), seen)
