"""What a study may leave unknown: read, refused, designed, solved by FE, inferred."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from varied_block import VariedStandIn, varied_stand_in

from calib.cli import main
from calib.inference import DirectForward
from calib.inference.corrected import has_slope
from calib.inference.inference_data import load_inference_data
from calib.study.artifacts import read_json
from calib.study.baseline import baseline
from calib.study.config import Study, StudyError, load_study, read_study
from calib.study.context import block_pin_model
from calib.study.design_next import design_next
from calib.study.finished import check_constants
from calib.study.prior_sections import ParameterPrior
from calib.study.sections import Cells, Hypothesis
from calib.study.stages import run_study
from calib.study.study_file import study_text
from calib.study.summary import load_summary
from calib.study.unknowns import (
    design_points,
    fixed_values,
    inputs_of,
    parameters_of,
    prior_of,
)
from calib.study.varied_block import VariedBlock
from fe.campaign_parameters import RATIOS
from fe.executors import serial_map
from fe.response import Array, Response
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact

TEXT = (Path(__file__).parents[1] / "calib/study/embedded/virtual.toml").read_text()
HYPOTHESES = TEXT[TEXT.index("[[hypothesis]]") : TEXT.index("[noise]")]
RUBS = '[[hypothesis]]\nname = "rubs"\npin = 0.3\nbase = 0.3\n'


DISCREPANCY = """
[prior.discrepancy]
distribution = "half_cauchy"
median = 0.1
low = 0.001
high = 2.0
"""


def uniform(section: str, low: float, high: float) -> str:
    return f'\n[{section}]\ndistribution = "uniform"\nlow = {low}\nhigh = {high}\n'


def text_of(hypotheses: str = HYPOTHESES, more: str = "", **changes: str) -> str:
    text = TEXT.replace(HYPOTHESES, hypotheses + "\n") + more
    name = "rubs" if 'name = "rubs"' in hypotheses else "sliding"
    text = text.replace('hypothesis = "sliding"', f'hypothesis = "{name}"')
    for old, new in changes.items():
        text = text.replace(f"{old} = ", f"{new} # ", 1)
    return text


def study_of(text: str) -> Study:
    return read_study(text.encode(), file="study.toml", folder=Path())


def refusal(text: str) -> str:
    with pytest.raises(StudyError) as caught:
        study_of(text)
    return str(caught.value)


def test_a_study_without_new_keys_has_the_model_and_the_columns_it_had() -> None:
    study = load_study("virtual")
    for hypothesis in study.hypotheses:
        assert parameters_of(study, hypothesis) == RATIOS
        model = block_pin_model(study, hypothesis, (2, 2, 1))
        assert isinstance(model, BlockPinModel)
        assert prior_of(study, hypothesis, with_field=True).space.names == ("kappa", "r", "s")


def test_a_hypothesis_adds_its_own_prior_and_overrides_that_of_the_study() -> None:
    own = uniform("hypothesis.prior.friction", 0.1, 0.5) + uniform("hypothesis.prior.r", 0.2, 0.4)
    study = study_of(text_of(RUBS + own + HYPOTHESES, uniform("prior.height", 2.4, 2.6)))
    rubs, stuck, _ = study.hypotheses
    assert inputs_of(study, rubs) == ("friction", "height")
    assert inputs_of(study, stuck) == ("height",)
    assert prior_of(study, rubs, with_field=False).bounds[1:].tolist() == [
        [0.2, 0.4],
        [0.0, 0.5],
        [0.1, 0.5],
        [2.4, 2.6],
    ]
    assert prior_of(study, stuck, with_field=False).bounds[1].tolist() == [0.0, 1.0]
    assert study_of(study_text(study)) == study


def test_the_design_covers_the_box_and_holds_the_logarithm_of_the_bulk_ratio() -> None:
    more = uniform("prior.bulk_ratio", 50.0, 800.0) + uniform("prior.fillet", 0.2, 0.4)
    study = study_of(text_of(more=more))
    hypothesis = study.hypotheses[0]
    names = [parameter.name for parameter in parameters_of(study, hypothesis)]
    assert names == ["r", "s", "ln bulk_ratio", "fillet"]
    points = design_points(study, hypothesis)
    bounds = prior_of(study, hypothesis, with_field=False).bounds[1:]
    assert points.shape == (24, 4)
    assert points.min(axis=0) == pytest.approx(bounds[:, 0])
    assert points.max(axis=0) == pytest.approx(bounds[:, 1])
    assert bounds[2] == pytest.approx(np.log([50.0, 800.0]))
    assert fixed_values(study, hypothesis) == pytest.approx([np.log(200.0), 0.3])


PENALTY = 2e-3
"""relative error of differences of FE forces over the steps below"""


@pytest.mark.lasting
@pytest.mark.parametrize("law", ["mooney-rivlin-3", "yeoh", "ogden-2"])
def test_slopes_of_the_varied_block_are_those_of_its_forces(law: str) -> None:
    template = BlockPinModel(
        specimen=block_pin_model(
            load_study("virtual"), load_study("virtual").hypotheses[1], (2, 2, 1)
        ).specimen,
        contact=_contact(),
        cells=(4, 2, 1),
        travel=(0.05, 0.15),
        field_grid=((1.0, 1.0), (3.0, 2.0)),
    )
    inputs = ("bulk_ratio", "friction", "height", "fillet")
    ratios = {"mooney-rivlin-3": [0.3, 0.1], "yeoh": [0.1, 0.02], "ogden-2": [1.5, -2.0, 0.2]}[law]
    model = VariedBlock(template, law, inputs)
    row = np.array([*ratios, np.log(100.0), 0.25, 2.5, 0.3])
    found = model(row)
    assert len(found.parameters) == row.size
    step = 1e-4  # within 2e-4 mm of this fillet no row of contact points passes its corner
    for column, name in enumerate(found.parameters):
        sides = []
        for sign in (1.0, -1.0):
            moved = row.copy()
            moved[column] += sign * step
            sides.append(model(moved))
        force = (sides[0].force - sides[1].force) / (2.0 * step)
        scale = np.abs(found.force) + np.abs(force)
        assert found.force_gradient[:, column] / scale == pytest.approx(
            force / scale, abs=PENALTY
        ), name
        field = (sides[0].displacement - sides[1].displacement) / (2.0 * step)
        assert found.displacement_gradient[..., column] == pytest.approx(field, abs=2e-3), name


@pytest.mark.lasting
def test_slopes_by_width_and_shift_of_the_pin_are_those_of_the_forces() -> None:
    template = BlockPinModel(
        specimen=BlockPin(),
        contact=Contact(pin=0.2, base="stick"),
        cells=(4, 2, 1),
        travel=(0.05, 0.15),
        field_grid=((1.0, 1.0), (3.0, 2.0)),
        symmetry="half",
    )
    model = VariedBlock(template, "mooney-rivlin-2", ("pin_friction", "pin_width", "pin_shift"))
    row = np.array([0.3, 0.25, 4.0, 0.2])
    found = model(row)
    assert found.parameters == ("r", "pin_friction", "pin_width", "pin_shift")
    for column, unit in enumerate(np.eye(4)):
        up, down = (model(row + sign * 1e-3 * unit) for sign in (1.0, -1.0))
        slope = (up.force - down.force) / 2e-3
        assert found.force_gradient[:, column] == pytest.approx(slope, rel=1e-3)


def test_a_derivative_that_the_block_has_not_is_nan_and_the_direct_model_says_so() -> None:
    """A posterior that leans on friction 0 has its maximum exactly there."""
    template = BlockPinModel(
        specimen=BlockPin(),
        contact=_contact(),
        cells=(4, 2, 1),
        travel=(0.05, 0.15),
        field_grid=((1.0, 1.0), (3.0, 2.0)),
    )
    model = VariedBlock(template, "mooney-rivlin-3", ("friction", "height"))
    found = model(np.array([0.3, 0.1, 0.0, 2.5]))
    assert found.parameters == ("r", "s", "friction", "height")
    assert np.isnan(found.force_gradient[:, 2]).all()
    assert np.isnan(found.displacement_gradient[..., 2]).all()
    others = np.delete(found.displacement_gradient, 2, axis=-1)
    assert np.isfinite(found.force_gradient[:, [0, 1, 3]]).all() and np.isfinite(others).all()
    slope = DirectForward(model, with_field=True).jacobian(np.array([[0.02, 0.3, 0.1, 0.0, 2.5]]))
    assert slope.force.shape == (1, 2, 5) and not has_slope(slope)
    assert slope.weights is not None
    assert slope.weights[0, :, 4] == pytest.approx(found.displacement_gradient[..., 3].ravel())


def _contact() -> Contact:
    return Contact(pin=0.2, base=0.2)


def test_the_varied_block_is_the_block_where_nothing_varies() -> None:
    study = load_study("virtual")
    plain = block_pin_model(study, study.hypotheses[1], (4, 2, 1))
    assert isinstance(plain, BlockPinModel)
    short = BlockPinModel(
        plain.specimen, plain.contact, plain.cells, (0.05,), field_grid=((1.0, 1.0),)
    )
    ratios = np.array([0.3, 0.1])
    found, expected = VariedBlock(short, "mooney-rivlin-3")(ratios), short(ratios)
    assert found.force == pytest.approx(expected.force, rel=1e-12)
    assert found.displacement == pytest.approx(expected.displacement, abs=1e-13)
    assert found.force_gradient == pytest.approx(expected.force_gradient, rel=1e-8)


def test_limits_of_a_pin_of_unknown_width_and_fillet_are_those_of_both_priors() -> None:
    """Not of the numbers that the priors take the place of."""
    study = load_study("thesis-forces")
    fillet = study.geometry.pin_fillet

    def with_priors(**limits: tuple[float, float]) -> Study:
        own = {
            name: ParameterPrior(distribution="uniform", low=low, high=high)
            for name, (low, high) in limits.items()
        }
        return replace(study, prior=replace(study.prior, **own))

    narrow = (1.9 * fillet, 4.2)
    with pytest.raises(ValueError, match=r"prior\.pin_width\.low: found 0\.57, expected 0\.6 or"):
        with_priors(pin_width=narrow)
    assert with_priors(pin_width=narrow, fillet=(0.06, 0.9 * fillet))
    with pytest.raises(ValueError, match=r"prior\.fillet\.high: found 0\.3, expected"):
        with_priors(pin_width=narrow, fillet=(0.06, fillet))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (text_of(more=uniform("prior.friction", 0.1, 0.5)), "prior.friction: found a table"),
        (
            text_of(RUBS + HYPOTHESES, uniform("prior.friction", -0.1, 0.5)),
            "prior.friction.low: found -0.1, expected 0 or more: it is a coefficient of friction",
        ),
        (
            text_of(
                RUBS + HYPOTHESES,
                uniform("prior.friction", 0.1, 0.5) + uniform("prior.pin_friction", 0.1, 0.5),
            ),
            "prior.pin_friction: found a table, expected none beside [prior.friction]",
        ),
        (
            text_of(
                RUBS.replace("base = 0.3", "base = 0.1") + HYPOTHESES,
                uniform("prior.friction", 0.1, 0.5),
            ),
            "hypothesis[0].base: found 0.1, expected 0.3 as for the pin: [prior.friction] is of",
        ),
        (
            text_of(HYPOTHESES + uniform("hypothesis.prior.friction", 0.1, 0.5)),
            "hypothesis[1].prior.friction: found a table, expected none: under sliding",
        ),
        (
            text_of(more=uniform("prior.height", 1.0, 2.6)),
            "prior.height.low: found 1.0, expected more than 1.4",
        ),
        (text_of(more=uniform("prior.height", 1.4, 2.6)), "prior.height.low: found 1.4"),
        (text_of(more=uniform("prior.height", 2.0, 9.0)), "prior.height.high: found 9.0, expected"),
        (
            text_of(more=uniform("prior.fillet", 0.01, 0.4)),
            "prior.fillet.low: found 0.01, expected",
        ),
        (text_of(more=uniform("prior.bulk_ratio", 0.5, 9.0)), "prior.bulk_ratio.low: found 0.5"),
        (
            text_of(more=uniform("prior.discrepancy_of_force", 0.5, 9.0)),
            "none without [prior.discrepancy] or noise.discrepancy",
        ),
        (
            text_of(more=DISCREPANCY.replace("median = 0.1\n", "")),
            "prior.discrepancy.median: found nothing, expected a number with the distribution",
        ),
        (
            text_of(more=DISCREPANCY).replace("[noise]", "[noise]\nforce_freedom = 4.0"),
            "prior.discrepancy: found a table, expected none beside noise.force_freedom",
        ),
        (
            TEXT.replace(
                'base = "stick"\n',
                'base = "stick"\n' + uniform("hypothesis.prior.pin_shift", -0.3, 0.3),
            ),
            "prior.pin_shift: found a table, expected it in [prior], for all hypotheses",
        ),
        (
            TEXT.replace("[design]", "[design]\nn_local = 2"),
            "design.n_local: found 2, expected 0 or at least 4 runs",
        ),
        (
            TEXT.replace("[noise]", "[noise]\ndiscrepancy = 0.1\nforce_freedom = 4.0"),
            "noise.discrepancy: found 0.1, expected 0 beside noise.force_freedom",
        ),
        (text_of(more=uniform("prior.c20", 0.0, 0.3)), "prior.c20: found a table, expected none"),
        (
            text_of(HYPOTHESES.replace('"sliding"\n', '"sliding"\nlaw = "gent"\n')),
            'hypothesis[1].law: found "gent", expected one of neo-hookean, mooney-rivlin-2',
        ),
        (
            text_of(HYPOTHESES.replace('"sliding"\n', '"sliding"\nlaw = "neo-hookean"\n')),
            "a further unknown with it",
        ),
        (
            text_of(HYPOTHESES.replace('"sliding"\n', '"sliding"\nlaw = "yeoh"\n')),
            "prior.c20: found nothing, expected a section [prior.c20]",
        ),
        (
            text_of(more=uniform("prior.field_noise", 0.0, 3.0)),
            "prior.field_noise.low: found 0.0, expected greater than 0: it is a size",
        ),
        (
            text_of(more=uniform("prior.bulk", 1.0, 3.0)),
            "prior.bulk: found an unknown key, expected one of positive, kappa, r, s",
        ),
        (
            text_of(HYPOTHESES.replace('"sliding"\n', '"sliding"\nlaw = "mooney-rivlin-2"\n')),
            "virtual.C11: found 0.0024, expected 0: the law of sliding, mooney-rivlin-2, has no",
        ),
        (
            text_of(more=uniform("prior.C10", 0.001, 0.01)),
            "prior.C01: found nothing, expected a section [prior.C01]",
        ),
    ],
)
def test_priors_that_make_no_sense_are_refused_in_one_sentence(text: str, expected: str) -> None:
    message = refusal(text)
    assert message.startswith("study.toml:") and expected in message
    assert "\n" not in message


def test_a_wrong_prior_stops_the_command_with_file_line_and_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text_of(more=uniform("prior.fillet", 0.01, 0.4)))
    line = path.read_text().splitlines().index("low = 0.01") + 1
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == (
        f"calib: {path}:{line}: prior.fillet.low: found 0.01, expected 0.05 or more: no sharp "
        "edge, and less than half of the pin's width\n"
    )


def test_nuisances_of_a_field_are_refused_where_there_is_none() -> None:
    text = (Path(__file__).parents[1] / "calib/study/embedded/thesis-forces.toml").read_text()
    for key in ("face_travel_sd", "rotation_sd", "field_freedom"):
        changed = text.replace("[noise]\n", f"[noise]\n{key} = 2.0\n")
        message = refusal(changed)
        assert f"noise.{key}: found 2.0, expected no such key: the data of this study" in message
    changed = text + uniform("prior.field_noise", 0.5, 2.0)
    assert "prior.field_noise: found a table, expected none: the data" in refusal(changed)


def by_constants(low: float = 0.0, more: str = "") -> str:
    text = text_of()
    start, end = text.index("[prior.kappa]"), text.index("[design]")
    priors = uniform("prior.C10", 0.005, 0.012) + uniform("prior.C01", low, 0.01)
    return text[:start] + more + priors + uniform("prior.C11", 0.0, 0.004) + "\n" + text[end:]


def test_negative_constants_are_refused_unless_the_study_allows_them() -> None:
    assert "0 or more, or prior.positive = false" in refusal(by_constants(-0.002))
    study = study_of(by_constants(-0.002, "[prior]\npositive = false\n"))
    prior = prior_of(study, study.hypotheses[0], with_field=False)
    assert prior.bounds[1, 0] < 0.0
    assert "1 or less: above, C10 is negative" in refusal(TEXT.replace("high = 1.0", "high = 1.2"))


def test_the_range_of_a_ratio_may_be_narrower_than_the_priors_of_constants_leave() -> None:
    text = by_constants().replace("[design]\n", "[design]\nr = [0.0, 0.4]\ns = [0.0, 0.3]\n")
    study = study_of(text)
    prior = prior_of(study, study.hypotheses[0], with_field=False)
    assert prior.bounds[1].tolist() == [0.0, 0.4]
    assert prior.log_mass < 0.0
    # It never widens what the constants allow: C01 / (C10 + C01) is 2 / 3 at most, C11 / kappa 0.8.
    wide = text.replace("r = [0.0, 0.4]\ns = [0.0, 0.3]", "r = [-1.0, 3.0]\ns = [-1.0, 2.0]")
    bounds = prior_of(study_of(wide), study.hypotheses[0], with_field=False).bounds
    np.testing.assert_allclose(bounds[1:], [[0.0, 2.0 / 3.0], [0.0, 0.8]], atol=1e-9)
    assert "design.r" in refusal(text.replace("r = [0.0, 0.4]", "r = [0.7, 0.9]"))


def _run(text: str, out: Path, factory: Any = varied_stand_in) -> Any:
    short = text.replace("max_steps = 20000", "max_steps = 3000")
    study = study_of(short.replace("n_ensembles = 4", "n_ensembles = 2"))
    return run_study(
        study,
        out,
        simulate_factory=factory,
        map_fn=serial_map,
        show_progress=False,
        echo=lambda _: None,
    )


@pytest.mark.slow  # two studies with up to five unknowns: minutes
def test_friction_height_and_bulk_are_inferred_beside_a_rival_law(tmp_path: Path) -> None:
    yeoh = '\n[[hypothesis]]\nname = "yeoh"\npin = 0.3\nbase = 0.3\nlaw = "yeoh"\n'
    yeoh += uniform("hypothesis.prior.c20", 0.0, 0.3) + uniform("hypothesis.prior.c30", 0.0, 0.1)
    more = uniform("prior.height", 2.3, 2.7) + uniform("prior.friction", 0.05, 0.6)
    result = _run(text_of(RUBS + yeoh, more), tmp_path)
    true, other = load_summary(result.posterior)
    assert set(other.constants) == {"C10", "C20", "C30", "mu"}
    assert set(true.further) == {"friction", "height"}
    assert true.further["height"].hdi_low < 2.5 < true.further["height"].hdi_high
    assert true.further["friction"].hdi_low < 0.3 < true.further["friction"].hdi_high
    assert true.truth is not None
    for name, constant in true.constants.items():
        assert constant.hdi_low < true.truth[name] < constant.hdi_high, name
    posterior = load_inference_data(result.posterior)["posterior"]
    assert np.isnan(posterior["C20"].sel(hypothesis="rubs")).all()
    assert np.isfinite(posterior["height"]).all()
    found = read_json(tmp_path / "comparison.json")["hypotheses"]
    assert found["rubs"]["log_evidence"] > found["yeoh"]["log_evidence"]
    said: list[str] = []
    gains, _ = design_next(tmp_path, "rubs", said.append)
    assert list(gains["now"]) == ["ln kappa", "r", "s", "friction", "height"]
    assert any("found the unknowns ln kappa, r, s, friction, height" in line for line in said)
    by_name = {plan["name"]: plan for plan in gains["plans"]}
    same = by_name["the same again"]
    assert same["sd_after"]["height"] < gains["now"]["height"]
    # Height and friction fill their priors, and of all densities with one covariance a normal one
    # gains most: the closed form may be too large, and whether it agrees is said.
    closed, lower, upper = (
        each["mean"] for each in (same["gain"], same["nested"]["lower"], same["nested"]["upper"])
    )
    error = 3.0 * np.hypot(same["nested"]["upper"]["error"], same["gain"]["error"])
    assert same["agree"] == (closed <= upper + error)
    assert lower - error < closed < 1.5 * lower
    assert same["gain"]["mean"] > by_name["no camera"]["gain"]["mean"] > 0.0
    lines, _ = baseline(tmp_path, "rubs")
    assert any("SYNTHETIC field (rubs)" in line for line in lines)


@pytest.mark.slow  # a study with seven unknowns: a minute or two
def test_priors_of_constants_with_unknown_noise_go_from_data_to_report(tmp_path: Path) -> None:
    sizes = uniform("prior.force_noise", 0.3, 3.0) + uniform("prior.field_noise", 0.3, 3.0)
    text = by_constants(more=sizes)
    text = text.replace(HYPOTHESES.split("[[hypothesis]]")[1], "").replace("[[hypothesis]][[", "[[")
    nuisances = "travel_zero_sd = 0.02\ncompliance_sd = 0.01\ngain_sd = 0.01\nrotation_sd = 0.05\n"
    result = _run(text.replace("travel_zero_sd = 0.02  # mm\n", nuisances), tmp_path)
    [summary] = load_summary(result.posterior)
    assert summary.truth is not None
    for name, constant in summary.constants.items():
        assert constant.hdi_low < summary.truth[name] < constant.hdi_high, name
    # 180 values say how large their noise is to 1 / sqrt(2 * 180) = 0.053, five forces do not
    assert summary.further["field_noise"].sd == pytest.approx(0.053, rel=0.2)
    assert summary.further["field_noise"].mean == pytest.approx(1.0, abs=0.2)
    assert summary.further["force_noise"].sd > 0.2
    [found] = read_json(tmp_path / "comparison.json")["hypotheses"].values()
    assert [entry["name"] for entry in found["nuisances"]] == [
        "zero of the travel",
        "compliance of the machine",
        "gain of the load cell",
    ]
    shares = [entry["sd"] / entry["prior_sd"] for entry in found["nuisances"]]
    # Of the gain the data say nothing; with noise of unknown size an SD after one experiment may be
    # a little above its prior's, which bounds its mean over experiments.
    assert max(shares[:2]) < 0.5 and shares[2] == pytest.approx(1.0, abs=0.02)
    assert (tmp_path / "prior" / "prior_predictive.png").is_file()
    assert "Nuisances of the test" in (tmp_path / "report.html").read_text()


@dataclass(frozen=True)
class Rubbing:
    """What the ratios say is not asked: an Ogden block of the same shear modulus that rubs."""

    block: VariedStandIn

    def points(self) -> Array:
        """Those of the block."""
        return self.block.points()

    def __call__(self, ratios: Array) -> Response:
        found = self.block(np.array([OGDEN]))
        by_force = np.zeros((len(found.force), len(ratios)))
        by_field = np.zeros((*found.displacement.shape, len(ratios)))
        return replace(
            found,
            force_gradient=by_force,
            displacement_gradient=by_field,
            parameters=("r", "s"),
        )


OGDEN = 6.0
"""exponent: at the largest compression 1.6 times as stiff as a neo-Hookean block"""


def wrong_truth(study: Study, hypothesis: Hypothesis, cells: Cells) -> Any:
    """The stand-in of the study; on the mesh of the truth a block that no constants explain."""
    block = varied_stand_in(study, hypothesis, cells)
    assert study.virtual is not None
    if cells != study.virtual.cells:
        return block
    return Rubbing(replace(block, law="ogden-1", columns=("alpha1",), friction=0.6))


@pytest.mark.slow  # two studies: a minute or two
def test_with_a_discrepancy_a_wrong_law_does_not_hide_the_shear_modulus(tmp_path: Path) -> None:
    text = TEXT.replace(HYPOTHESES, HYPOTHESES[HYPOTHESES.index("[[hypothesis]]", 5) :])
    found = {}
    for name, more in (("without", ""), ("with", DISCREPANCY)):
        result = _run(text + more, tmp_path / name, wrong_truth)
        [summary] = load_summary(result.posterior)
        assert summary.truth is not None
        found[name] = summary.constants["mu"]
    mu = summary.truth["mu"]
    assert not found["without"].hdi_low < mu < found["without"].hdi_high
    # Central, as in docs/verification.md: an interval of highest density of a skewed posterior
    # leaves out its long side first.
    low, high = load_inference_data(result.posterior)["posterior"]["mu"].quantile([0.025, 0.975])
    assert low < mu < high
    # The field says how wrong the model is, and the prior of mu does not decide.
    assert 0.03 < summary.further["discrepancy"].mean < 0.5
    assert found["with"].sd < 0.6 * mu
    [compared] = read_json(tmp_path / "with" / "comparison.json")["hypotheses"].values()
    assert len(compared["ln_force_factor"]["mean"]) == 5
    report = (tmp_path / "with" / "report.html").read_text()
    assert "share by which the model errs" in report and "factor of the predicted forces" in report


@pytest.mark.slow  # some fifty runs of the FE model on a tiny mesh
def test_bulk_ratio_and_height_are_inferred_with_the_fe_model(tmp_path: Path) -> None:
    text = TEXT.replace(HYPOTHESES, HYPOTHESES[HYPOTHESES.index("[[hypothesis]]", 5) :])
    text = text.replace("increments = [0.6, 0.8, 1.0, 1.2, 1.4]", "increments = [0.1, 0.2, 0.3]")
    text = text.replace("cells = [20, 8, 4]", "cells = [8, 4, 2]").replace(
        "n_samples = 23", "n_samples = 9"
    )
    text = text.replace("sampling = [12, 4, 2]", "sampling = [4, 2, 1]")
    text = text.replace("check = [16, 6, 3]", "check = [6, 3, 2]")
    text = text.replace("load_cell_sd = 0.0722", "load_cell_sd = 0.001")
    text = text.replace("n_runs = 20", "n_runs = 24").replace(
        "max_steps = 20000", "max_steps = 3000"
    )
    text = text.replace("max_force_error = 0.02", "max_force_error = 0.2")
    text = text.replace("n_ensembles = 4", "n_ensembles = 2")
    more = uniform("prior.height", 2.4, 2.6) + uniform("prior.bulk_ratio", 100.0, 400.0)
    study = study_of(text + more)
    result = run_study(
        study, tmp_path, workers=1, show_progress=False, echo=lambda _: None, map_fn=serial_map
    )
    [summary] = load_summary(result.posterior)
    assert set(summary.further) == {"bulk_ratio", "height"}
    assert 2.4 < summary.further["height"].mean < 2.6
    [maximum] = read_json(tmp_path / "map.json").values()
    assert maximum["fe_x"] is not None and len(maximum["fe_x"]) == 5
    diagnostics = read_json(tmp_path / "diagnostics.json")["sliding"]
    assert diagnostics["inputs"] == ["r [-]", "s [-]", "ln bulk_ratio [-]", "height [mm]"]
    assert diagnostics["n_with_gradients"] > 0


def test_the_thesis_method_refuses_another_law() -> None:
    yeoh = '\n[[hypothesis]]\nname = "yeoh"\npin = "slide"\nbase = "slide"\nlaw = "yeoh"\n'
    yeoh += uniform("hypothesis.prior.c20", 0.0, 0.3) + uniform("hypothesis.prior.c30", 0.0, 0.1)
    plain, other = study_of(TEXT), study_of(text_of(HYPOTHESES + yeoh))
    check_constants(plain, plain.hypotheses[0])
    with pytest.raises(ValueError, match="found the law yeoh, expected mooney-rivlin-3"):
        check_constants(other, other.hypotheses[-1])


@pytest.mark.parametrize("low", [-1.0, 0.5])
def test_an_impossible_height_is_refused_where_it_stands(low: float) -> None:
    text = TEXT + uniform("prior.height", low, 2.6)
    said = refusal(text)
    line = text.splitlines().index(f"low = {low}") + 1
    assert said.startswith(f"study.toml:{line}: prior.height.low: found {low}, expected")
