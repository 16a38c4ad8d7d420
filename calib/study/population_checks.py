"""What is refused of a study whose samples are taken one by one, each in one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.data import Dataset
from calib.study.data_sections import VIRTUAL, DataSource
from calib.study.unknown_checks import section_of
from calib.study.unknowns import ERRORS, given, prior_of
from calib.toml_file.refusal import Contradiction

if TYPE_CHECKING:
    from calib.study.config import Study

SAMPLES = "samples"
OTHERS = '"mean" or "summary"'


def check_population(study: Study) -> None:
    """Raise Contradiction where level and [population] do not go together, or name nothing."""
    level, population = study.data.level, study.population
    if population is None:
        if level == SAMPLES:
            raise Contradiction("data.level", level, "a section [population] with it")
        return
    if level != SAMPLES:
        raise Contradiction("population", {}, f"none with data.level = {level!r}")
    if study.data.source == VIRTUAL:
        raise Contradiction("data.level", level, f"{OTHERS}: synthetic data are those of the mean")
    if study.noise.discrepancy > 0:
        expected = f'0 with data.level = "{SAMPLES}", where the model is taken as right'
        raise Contradiction("noise.discrepancy", study.noise.discrepancy, expected)
    if study.noise.force_freedom is not None:
        expected = f'none with data.level = "{SAMPLES}", where errors of the forces are normal'
        raise Contradiction("noise.force_freedom", study.noise.force_freedom, expected)
    known: set[str] = set()
    for index, hypothesis in enumerate(study.hypotheses):
        for name in ERRORS:
            if given(study, hypothesis, name) is not None:
                expected = f'none with data.level = "{SAMPLES}", where errors have known sizes'
                raise Contradiction(section_of(study, index, name), {}, expected)
        space = prior_of(study, hypothesis, with_field=True).space
        names = space.names[: space.n_forward]
        if not set(names) & set(population.scatter):
            expected = f"one or more of {', '.join(names)}, the unknowns of {hypothesis.name}"
            raise Contradiction("population.scatter", dict(population.scatter), expected)
        known |= set(names)
        unknowns = space.size + len(set(names) & set(population.scatter))
        if study.sampler.n_walkers < 2 * unknowns:
            expected = f"at least twice the {unknowns} unknowns of the population"
            raise Contradiction("sampler.n_walkers", study.sampler.n_walkers, expected)
    for name, size in population.scatter.items():
        if name not in known:
            expected = f"an unknown of the forward model: {', '.join(sorted(known))}"
            raise Contradiction(f"population.scatter.{name}", size, expected)


def check_level(data: DataSource, measured: Dataset) -> None:
    """Raise Contradiction where samples are asked for one by one and the data hold too few."""
    if data.level != SAMPLES:
        return
    if measured.samples is None:
        raise Contradiction(
            "data.level", data.level, f"{OTHERS}: these data hold no samples one by one"
        )
    if measured.n_samples < 2:
        expected = f"{OTHERS}: of the scatter between samples one sample says nothing"
        raise Contradiction("data.level", data.level, expected)
