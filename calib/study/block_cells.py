"""How a study file names the mesh of a block: a grid, or rings that follow a round pin's rim."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag
from pydantic.dataclasses import dataclass

from calib.toml_file.refusal import Contradiction
from calib.toml_file.strict import STRICT
from fe import Rings

Count = Annotated[int, Field(ge=1)]
Cells = tuple[Count, Count, Count]
"""numbers of elements along x, y, z of the quarter"""

MOST_ELEMENTS = 20_000
"""of a quarter: some 500,000 unknowns, two and a half times those of the thesis' finest mesh"""
MIN_REFINEMENT = 1.3
"""less says too little of the error: it is read off a difference that gets small by itself"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class RingCells:
    """{ rings, layers, sectors } Elements of a quarter along the rim of a round pin."""

    rings: Count
    """number of rings from the core under the pin to the block's sides"""
    layers: Count
    """number of layers over the height"""
    sectors: Count = 2
    """number of elements along an eighth of the rim"""


def _kind(value: Any) -> str:
    return "<rings>" if isinstance(value, dict | RingCells) else "<grid>"


BlockCells = Annotated[
    Annotated[Cells, Tag("<grid>")] | Annotated[RingCells, Tag("<rings>")], Discriminator(_kind)
]
"""of a table the rings, of an array the grid"""


def model_cells(cells: Cells | RingCells) -> Cells | Rings:
    """The mesh as the FE model takes it."""
    if isinstance(cells, RingCells):
        return Rings(cells.rings, cells.layers, cells.sectors)
    return cells


def written(cells: Cells | RingCells) -> str:
    """The mesh as a reader of the study's tables sees it."""
    if isinstance(cells, RingCells):
        return f"{cells.rings} rings x {cells.layers} layers x {cells.sectors} sectors"
    return " x ".join(str(n) for n in cells)


def n_elements(cells: Cells | RingCells | Rings) -> int:
    """Number of elements of the quarter."""
    if isinstance(cells, RingCells | Rings):
        return cells.layers * cells.sectors * (cells.sectors + 2 * cells.rings)
    return math.prod(cells)


def check_size(key: str, cells: Cells | RingCells | None) -> None:
    """Raise Contradiction, at `key`, for a mesh of more than `MOST_ELEMENTS`: a slip of the pen."""
    if cells is not None and n_elements(cells) > MOST_ELEMENTS:
        expected = f"at most {MOST_ELEMENTS:,} elements in all, not {n_elements(cells):,}"
        raise Contradiction(key, as_found(cells), expected)


def refinement(check: Cells | RingCells | Rings, sampling: Cells | RingCells | Rings) -> float:
    """Edge of the sampling mesh's elements over that of `check`'s, mean of directions."""
    return math.cbrt(n_elements(check) / n_elements(sampling))


def shows_error(check: Cells | RingCells, sampling: Cells | RingCells) -> bool:
    """Whether the difference of the two meshes says enough about the sampling mesh's error."""
    return is_finer(check, sampling) and refinement(check, sampling) >= MIN_REFINEMENT


def finer_than(sampling: Cells | RingCells) -> str:
    """What a checking mesh is expected to be, in words."""
    kind = " of rings too," if isinstance(sampling, RingCells) else ""
    return (
        f"a mesh finer than the sampling mesh {shown(sampling)},{kind} with elements at least "
        f"{MIN_REFINEMENT} times smaller (cube root of the ratio of their numbers)"
    )


def shown(cells: Cells | RingCells) -> str:
    """The mesh as a study file has it."""
    if isinstance(cells, RingCells):
        return f"{{ rings = {cells.rings}, layers = {cells.layers}, sectors = {cells.sectors} }}"
    return str(list(cells))


def as_found(cells: Cells | RingCells) -> object:
    """What a refusal shows of a mesh."""
    return shown(cells) if isinstance(cells, RingCells) else cells


def is_finer(fine: Cells | RingCells, coarse: Cells | RingCells) -> bool:
    """Of one kind; no direction has fewer elements and at least one has more."""
    if isinstance(fine, RingCells) != isinstance(coarse, RingCells):
        return False
    pairs = zip(_numbers(fine), _numbers(coarse), strict=True)
    return fine != coarse and all(f >= c for f, c in pairs)


def _numbers(cells: Cells | RingCells) -> tuple[int, ...]:
    if isinstance(cells, RingCells):
        return cells.rings, cells.layers, cells.sectors
    return cells
