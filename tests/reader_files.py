"""What the tests of the readers share."""

from __future__ import annotations

import pytest

from calib.data.readers import WrongFile


def refusal(read, *arguments):
    """The refusal of a wrong file; its text is one sentence."""
    with pytest.raises(WrongFile) as caught:
        read(*arguments)
    assert "\n" not in str(caught.value)
    return caught.value
