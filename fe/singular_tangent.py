"""The error of a factorisation that fails."""

from __future__ import annotations


class SingularTangentError(ArithmeticError):
    """A tangent that a library could not factorise: the step that asked for it is cut.

    A class of its own, so that errors of a caller's functions are not taken for it.
    """
