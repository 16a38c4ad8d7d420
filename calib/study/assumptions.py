"""What a study assumes, value by value, for the report."""

from __future__ import annotations

from calib.data import Dataset
from calib.inference.field_floor import PROFILE_LEAST, PROFILE_LENGTH
from calib.inference.field_noise import FLOOR_LENGTH, FLOOR_NUGGET
from calib.inference.laws import RATIOS
from calib.inference.noise import field_scale_sd, travel_zero_sd
from calib.inference.tangent_errors import TRAVEL_LENGTH
from calib.study.block_cells import written
from calib.study.config import Study
from calib.study.mesh_error import FORCE_BEYOND, left_share
from calib.study.posterior_setup import noise_of
from calib.study.prior_limits import is_positive
from calib.study.sections import Hypothesis, ParameterPrior, Virtual
from calib.study.tables import Table
from calib.study.unknowns import ERRORS, INPUTS, given, inputs_of, law_of, off_centre
from calib.study.usual_meshes import field_order

BY_LOGARITHM = ("kappa", "bulk_ratio")
"""parameters of which the logarithm scatters"""
_STATED = ", stated by the data"


def assumptions_table(study: Study, dataset: Dataset) -> Table:
    """Everything that is set rather than measured: geometry, contact, material, noise, prior.

    Where the `dataset` brings an SD of its own, that used is given, with where it is from.
    """
    geometry, noise = study.geometry, study.noise
    zero = travel_zero_sd(dataset, noise_of(study))
    rows = [
        (
            "sample, width x height x depth",
            f"{geometry.width:g} x {geometry.height:g} x {geometry.depth:g}",
            "mm",
        ),
        ("pin, width and edge radius", f"{geometry.pin_width:g}, {geometry.pin_fillet:g}", "mm"),
        ("bulk modulus over shear modulus", f"{study.material.bulk_ratio:g}", "-"),
    ]
    if geometry.pin_shift != 0.0:
        rows.append(("pin off the sample's centre", f"{geometry.pin_shift:g}", "mm"))
    rows += [
        *_hypothesis_rows(study),
        *_force_rows(study, dataset),
        *_population_rows(study),
        (f"zero of the travel, SD{_STATED * (zero > noise.travel_zero_sd)}", f"{zero:g}", "mm"),
        *_nuisance_rows(study, dataset),
        *_prior_rows(study),
        *_mesh_rows(study),
        (f"samples independent of each other{_known_sds(study, dataset)}", "", "-"),
    ]
    if study.virtual is not None:
        rows += _field_noise_rows(study.virtual)
    if dataset.field is not None:
        rows += _FIELD_MESH_ROWS
    return Table(
        "What the study assumes",
        ("assumption", "value", "unit"),
        tuple(rows),
        "Contact: stick, slide (no friction) or a coefficient of Coulomb friction. Other contact, "
        "pins, heights and laws are not part of this study. A number that has a prior too is used "
        "for the truth of a synthetic experiment alone.",
    )


def _known_sds(study: Study, dataset: Dataset) -> str:
    """What is assumed of the SDs between samples, where all hypotheses take them as given."""
    free = [given(study, hypothesis, "force_noise") is not None for hypothesis in study.hypotheses]
    allowed = study.noise.force_freedom is not None or dataset.force_covariance is not None
    return "" if all(free) or allowed else ", their SDs taken as known"


def _hypothesis_rows(study: Study) -> list[tuple[str, str, str]]:
    """Law, contact and height of each hypothesis."""
    return [
        (
            f"law and contact under {hypothesis.name}",
            f"{law_of(study, hypothesis).name}, pin: {hypothesis.pin}, base: {hypothesis.base}, "
            f"height {study.height(hypothesis):g} mm" + _own_bulk(study, hypothesis),
            "-",
        )
        for hypothesis in study.hypotheses
    ]


def _own_bulk(study: Study, hypothesis: Hypothesis) -> str:
    """The bulk modulus that a hypothesis has of its own, unless it is unknown."""
    if hypothesis.bulk_ratio is None or "bulk_ratio" in inputs_of(study, hypothesis):
        return ""
    return f", bulk modulus {hypothesis.bulk_ratio:g} mu"


def _mesh_rows(study: Study) -> list[tuple[str, str, str]]:
    """Meshes of each hypothesis, and what their difference leaves as an error."""
    rows = []
    for hypothesis in study.hypotheses:
        sampling, check = study.sampling_cells(hypothesis), study.check_cells(hypothesis)
        finer, order = study.refinement(hypothesis), field_order(hypothesis)
        shares = f"{left_share(finer):.2f} of forces, {left_share(finer, order):.2f} of fields"
        part = "half" if off_centre(study, hypothesis) else "quarter"
        rows += [
            (
                f"mesh of the emulator's runs, {hypothesis.name} ({part})",
                written(sampling),
                "elements",
            ),
            (f"mesh of the check under {hypothesis.name}", written(check), "elements"),
            (
                "mesh error left after the correction, SD over the measured difference",
                f"{shares}, half of its square common to all increments",
                "-",
            ),
        ]
    stiffening = study.mesh.check_stiffening
    rows.append(("how many times less the pin of the check gives way", f"{stiffening:g}", "-"))
    if stiffening == 1.0:
        rows.append(("compliance of the pin", "neither corrected for nor part of the errors", "-"))
    else:
        beyond = 1.0 / (stiffening - 1.0)
        rows.append(("a rigid pin beyond it, over the difference of the two", f"{beyond:.2f}", "-"))
        left = f"{FORCE_BEYOND * beyond:.2f} of forces, {beyond:.2f} of fields"
        rows.append(("of that left, SD over the difference", left, "-"))
    return rows


def _nuisance_rows(study: Study, dataset: Dataset) -> list[tuple[str, str, str]]:
    """Nuisances of the test that the study allows for."""
    noise = study.noise
    scale = field_scale_sd(dataset, noise_of(study))
    stated = _STATED * (scale > noise.field_scale_sd)
    known = (
        ("compliance of the machine, SD", noise.compliance_sd, "mm/N"),
        ("travel at the front face less that of the force, SD", noise.face_travel_sd, "mm"),
        ("gain of the load cell, relative SD", noise.gain_sd, "-"),
        (f"scale of the field, relative SD{stated}", scale, "-"),
        ("rigid translation of the field at each increment, SD", noise.translation_sd, "mm"),
        ("rigid rotation of the field at each increment, SD", noise.rotation_sd, "degrees"),
    )
    rows = [(name, f"{value:g}", unit) for name, value, unit in known if value > 0]
    for name, freedom in (
        ("errors of the force, Student-t", noise.force_freedom),
        ("noise of the field, Student-t", noise.field_freedom),
    ):
        if freedom is not None:
            rows.append((name, f"{freedom:g}", "degrees of freedom"))
    return rows + _discrepancy_rows(study)


def _discrepancy_rows(study: Study) -> list[tuple[str, str, str]]:
    """What a discrepancy is taken to be like, where the study allows for one."""
    noise = study.noise
    priors = (study.prior, *(h.prior for h in study.hypotheses if h.prior is not None))
    unknown = any(prior.discrepancy is not None for prior in priors)
    if not unknown and noise.discrepancy == 0:
        return []
    share = "has a prior" if unknown else f"{noise.discrepancy:g}"
    given_ratio = any(prior.discrepancy_of_force is not None for prior in priors)
    open_ratio = given_ratio or (unknown and noise.discrepancy_of_force is None)
    ratio = "has a prior" if open_ratio else f"{noise.ratio:g}"
    return [
        ("share by which the model errs, SD", share, "-"),
        ("SD of ln of the forces' common factor over it", ratio, "-"),
        ("its correlation length over the front face", f"{noise.discrepancy_length:g}", "mm"),
        ("its correlation length over the travel", f"{noise.discrepancy_travel_length:g}", "mm"),
    ]


_MEANINGS = {
    "kappa": ("kappa = mu / 2", "MPa"),
    **{name: (name, "MPa") for name in ("C10", "C01", "C11")},
    **{
        ratio.name: (f"{ratio.name} = {ratio.meaning}", "-")
        for ratios in RATIOS.values()
        for ratio in ratios
    },
    **{
        u.name: (f"{u.name}, {u.meaning}", "-" if u.unit == "1" else u.unit)
        for u in (*(u for u, _ in INPUTS.values()), *ERRORS.values())
    },
}


def _prior_rows(study: Study) -> list[tuple[str, str, str]]:
    """Every prior of the study and of its hypotheses, and whether constants may be negative."""
    rows = []
    sections = [("", study.prior), *((f" under {h.name}", h.prior) for h in study.hypotheses)]
    for where, section in sections:
        for name, (meaning, unit) in _MEANINGS.items():
            prior = None if section is None else getattr(section, name)
            if prior is not None:
                rows.append((f"prior of {meaning}{where}", _prior(prior), unit))
    word = "not allowed, by convention" if is_positive(study) else "allowed"
    return [*rows, ("negative constants", word, "-")]


def _force_rows(study: Study, dataset: Dataset) -> list[tuple[str, str, str]]:
    """What the covariance of the mean force is made of."""
    noise = study.noise
    if dataset.force_covariance is not None:
        return [("covariance of the mean force", "measured between the samples", "-")]
    return [
        ("load cell, SD of one reading", f"{noise.load_cell_sd:g}", "N"),
        (
            "correlation of one sample's deviation between neighbouring increments",
            f"{noise.sample_correlation:g}",
            "-",
        ),
    ]


def _population_rows(study: Study) -> list[tuple[str, str, str]]:
    """What is assumed of the samples one by one, where they are."""
    if (found := study.population) is None:
        return []
    free = found.freedom
    half = "half-normal" if free is None else f"half Student-t of {free:g} degrees of freedom"
    rows = [
        (
            f"SD of {name} between samples{', relative' * (name in BY_LOGARITHM)}, {half} of size",
            f"{size:g}",
            "-" if name in BY_LOGARITHM else _MEANINGS[name][1],
        )
        for name, size in found.scatter.items()
    ]
    return [
        *rows,
        ("SDs of different parameters between samples", "independent; other unknowns common", "-"),
        ("a sample's own forces, SD by the load cell", f"{study.noise.load_cell_sd:g}", "N"),
        ("zero of a sample's travel about that of all, SD", f"{found.travel_zero_sd:g}", "mm"),
    ]


def _field_noise_rows(virtual: Virtual) -> list[tuple[str, str, str]]:
    noise = ", ".join(f"{sd:g}" for sd in virtual.field_noise_std)
    return [
        ("noise of the field, SD of x, y, z", noise, "mm"),
        ("its correlation length over the points", f"{virtual.field_correlation_length:g}", "mm"),
        ("its share common to all increments", f"{virtual.field_reference_share:g}", "-"),
    ]


_FIELD_MESH_ROWS = [
    (
        "correlation length of the field's mesh error",
        f"{FLOOR_LENGTH:g}; {FLOOR_NUGGET:g} of it uncorrelated",
        "mm",
    ),
    (
        "length over which its size on the face is averaged from the difference of the meshes",
        f"{PROFILE_LENGTH:g}; at least {PROFILE_LEAST:g} of its RMS",
        "mm",
    ),
    (
        "length over which its parts that look like other constants are correlated in travel",
        f"{TRAVEL_LENGTH:g}",
        "mm",
    ),
]


def _prior(prior: ParameterPrior) -> str:
    text = f"{prior.distribution.replace('_', '-')} on {prior.low:g} to {prior.high:g}"
    if prior.median is not None:
        return f"{text}, median {prior.median:g}"
    if prior.mean is None:
        return text
    return f"{text}, mean {prior.mean:g}, SD {prior.sd:g}"
