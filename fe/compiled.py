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

    That is the kernels it calls, those they call, and constants of modules.
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
    """Twelve hex digits of what is compiled into a kernel, its own code too."""
    found = hashlib.sha256()
    for part in _parts(f, options, set()):
        found.update(part.encode() + b"\0")
    return found.hexdigest()[:12]


def _parts(f: Any, options: dict[str, Any], seen: set[str]) -> Iterator[str]:
    name = f"{f.__module__}.{f.__name__}"
    if name in seen:
        return
    seen.add(name)
    yield name
    for key, value in sorted(options.items()):
        yield f"{key}={sorted(value) if isinstance(value, (set, frozenset)) else value}"
    for code in _codes(f.__code__):
        yield code.co_code.hex()
        yield repr([const for const in code.co_consts if not isinstance(const, CodeType)])
        for used in code.co_names:
            yield used
            yield from _value(f.__globals__.get(used), code.co_names, seen)


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of comprehensions and functions in it."""
    yield code
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _codes(const)


def _value(value: Any, names: tuple[str, ...], seen: set[str]) -> Iterator[str]:
    """What a global says of the machine code; of a module of ours, what is named of it."""
    if hasattr(value, "py_func"):
        yield from _parts(value.py_func, value.targetoptions, seen)
    elif isinstance(value, (bool, int, float, complex, str, tuple)):
        yield repr(value)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, ModuleType) and value.__name__.split(".")[0] in OWN:
        for name in names:
            inner = getattr(value, name, None)
            if not isinstance(inner, ModuleType):
                yield from _value(inner, names, seen)
