"""What is refused of the meshes of a study, each in one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from calib.study.block_cells import (
    MIN_REFINEMENT,
    Cells,
    RingCells,
    as_found,
    finer_than,
    is_finer,
    shown,
    shows_error,
)
from calib.study.unknowns import given, off_centre
from calib.toml_file.refusal import Contradiction
from fe.specimens.ring_mesh import LONGEST, WIDEST

if TYPE_CHECKING:
    from calib.study.config import Study
    from calib.study.sections import Hypothesis


def check_meshes(study: Study) -> None:
    """Raise Contradiction for meshes that show no error, and rings that no pin has."""
    for index, hypothesis in enumerate(study.hypotheses):
        for key, cells in _meshes(study, index, hypothesis):
            if isinstance(cells, RingCells):
                _check_rings(study, hypothesis, key, cells)
        _check_refinement(study, index, hypothesis)
    if study.virtual is None:
        return
    for hypothesis in study.hypotheses:
        cells = study.sampling_cells(hypothesis)
        if not is_finer(study.virtual.cells, cells):
            expected = f"a mesh finer than the sampling mesh {shown(cells)}"
            raise Contradiction("virtual.cells", as_found(study.virtual.cells), expected)
    least = 2.0 * study.mesh.check_stiffening
    if study.mesh.check_stiffening > 1.0 and study.virtual.stiffening < least:
        expected = f"{least:g} at least, twice mesh.check_stiffening"
        raise Contradiction("virtual.stiffening", study.virtual.stiffening, expected)


def _meshes(
    study: Study, index: int, hypothesis: Hypothesis
) -> Iterator[tuple[str, Cells | RingCells]]:
    """Key in the file and mesh of all that is named and solved under a hypothesis."""
    for name, own, common in (
        ("sampling", hypothesis.sampling, study.mesh.sampling),
        ("check", hypothesis.check, study.mesh.check),
    ):
        if own is not None:
            yield f"hypothesis.{index}.{name}", own
        elif common is not None:
            yield f"mesh.{name}", common
    if study.virtual is not None and study.virtual.hypothesis == hypothesis.name:
        yield "virtual.cells", study.virtual.cells


def _check_refinement(study: Study, index: int, hypothesis: Hypothesis) -> None:
    check, sampling = study.check_cells(hypothesis), study.sampling_cells(hypothesis)
    if shows_error(check, sampling):
        return
    own = f"hypothesis.{index}"
    if hypothesis.check is not None:
        raise Contradiction(f"{own}.check", as_found(check), finer_than(sampling))
    if study.mesh.check is not None and hypothesis.sampling is None:
        raise Contradiction("mesh.check", as_found(check), finer_than(sampling))
    key = "mesh.sampling" if hypothesis.sampling is None else f"{own}.sampling"
    if study.mesh.check is None:
        beside = (
            f"mesh.check beside it, {finer_than(sampling)}: that of the contact is {shown(check)}"
        )
        raise Contradiction(key, as_found(sampling), beside)
    expected = f"a mesh that mesh.check {shown(check)} is {MIN_REFINEMENT} times finer than"
    raise Contradiction(key, as_found(sampling), expected)


def _check_rings(study: Study, hypothesis: Hypothesis, key: str, cells: RingCells) -> None:
    """Rings follow the rim of a round pin in the middle, with room around it."""
    found, geometry = as_found(cells), study.geometry
    if study.pin_shape(hypothesis) != "round":
        expected = (
            f"three numbers of elements under {hypothesis.name}: rings follow the rim of a pin of "
            'pin_shape = "round", and this one is a bar'
        )
        raise Contradiction(key, found, expected)
    if off_centre(study, hypothesis):
        section = "[prior.pin_shift]" if geometry.pin_shift == 0.0 else "geometry.pin_shift"
        expected = (
            f"three numbers of elements under {hypothesis.name}: {section} takes the pin off the "
            "middle, and rings are about a pin in the middle"
        )
        raise Contradiction(key, found, expected)
    widths = given(study, hypothesis, "pin_width")
    widest = geometry.pin_width if widths is None else widths.high
    narrow, wide = sorted((geometry.width, geometry.depth))
    if widest > WIDEST * narrow or wide > LONGEST * narrow:
        expected = (
            f"three numbers of elements: rings need a pin at most {WIDEST:g} times as wide as the "
            f"sample ({WIDEST * narrow:g} mm, here up to {widest:g} mm) and sides of a ratio up to "
            f"{LONGEST:g} (here {wide / narrow:.3g})"
        )
        raise Contradiction(key, found, expected)
