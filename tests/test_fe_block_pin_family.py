"""A row of a design becomes block, pin and contact, and the solution of just that model."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import (
    FAMILY,
    Bar,
    BlockPin,
    BlockPinFamily,
    BlockPinModel,
    CampaignPlan,
    Contact,
    NotchedPlate,
    TensileModel,
    UniaxialModel,
    run_campaign,
)

TEMPLATE = BlockPinModel(
    specimen=BlockPin(), contact=Contact("stick", "stick"), cells=(3, 2, 2), travel=(0.1, 0.2)
)
ALL = tuple(FAMILY.values())
ROW = np.array([0.4, 0.1, 50.0, 0.3, 2.7, 0.4, 1.0, 1.0])


def _of(*names: str, template: BlockPinModel = TEMPLATE) -> BlockPinFamily:
    return BlockPinFamily(template, tuple(FAMILY[name] for name in names))


def _but_for_gradients(model: BlockPinModel) -> BlockPinModel:
    """The model without what it was asked to have gradients in, where that can be asked."""
    return replace(model, sensitivities=None) if hasattr(model, "sensitivities") else model


def test_every_parameter_goes_where_it_belongs() -> None:
    assert [p.name for p in ALL] == [
        "r", "s", "bulk", "friction", "height", "fillet", "pin", "contact",
    ]  # fmt: skip
    model = BlockPinFamily(TEMPLATE, ALL).model(ROW)
    specimen = replace(TEMPLATE.specimen, height=2.7, pin_fillet=0.4, pin="round")
    expected = replace(
        TEMPLATE, specimen=specimen, contact=Contact(pin=0.3, base=0.3), bulk_ratio=50.0
    )
    assert _but_for_gradients(model) == expected


def test_what_is_no_parameter_is_as_in_the_template() -> None:
    template = replace(TEMPLATE, contact=Contact(pin="slide", base="stick"), bulk_ratio=77.0)
    model = _of("height", template=template).model(np.array([2.6]))
    expected = replace(template, specimen=replace(template.specimen, height=2.6))
    assert _but_for_gradients(model) == expected


@pytest.mark.parametrize(
    ("names", "row", "contact"),
    [
        (("contact",), [0.0], Contact("stick", "stick")),
        (("contact",), [1.0], Contact("slide", "slide")),
        (("friction", "contact"), [0.3, 0.0], Contact("stick", "stick")),
        (("friction", "contact"), [0.3, 1.0], Contact(0.3, 0.3)),
        (("friction", "contact"), [0.0, 1.0], Contact(0.0, 0.0)),
    ],
)
def test_contact_sticks_or_slides_with_the_friction_given(
    names: tuple[str, ...], row: list[float], contact: Contact
) -> None:
    assert _of(*names).model(np.array(row)).contact == contact


def test_friction_acts_where_the_template_slides() -> None:
    template = replace(TEMPLATE, contact=Contact(pin="slide", base="stick"))
    assert _of("friction", template=template).model(np.array([0.2])).contact == Contact(
        0.2, "stick"
    )


def test_a_family_solves_what_its_model_solves(tmp_path: Path) -> None:
    family = pickle.loads(pickle.dumps(_of("height", "s", "pin", "r")))
    theta = np.array([[2.6, 0.1, 0.0, 0.4], [2.5, 0.1, 1.0, 0.4]])
    campaign = run_campaign(family, theta, tmp_path, parameters=family.parameters)
    assert campaign.reached.all() and {"s", "r"} <= set(campaign.gradient_parameters)
    for row, force in zip(theta, campaign.force, strict=True):
        model = replace(
            TEMPLATE, specimen=BlockPin(height=row[0], pin="round" if row[2] else "bar")
        )
        np.testing.assert_array_equal(force, model(np.array([0.4, 0.1])).force)
    bar, round_pin = campaign.force
    assert (round_pin < bar).all(), "a round pin touches less"


def test_a_parameter_that_is_not_of_the_family_is_named() -> None:
    with pytest.raises(ValueError, match=r"parameters: expected r, s, bulk, .* found 'colour'"):
        BlockPinFamily(TEMPLATE, (replace(FAMILY["r"], name="colour"),))


@pytest.mark.parametrize(
    "changed",
    [
        replace(FAMILY["height"], unit="m"),
        replace(FAMILY["pin"], levels=("bar", "cone")),
        replace(FAMILY["pin"], levels=()),
        replace(FAMILY["height"], levels=("low", "high")),
    ],
)
def test_units_and_levels_that_are_not_of_the_family_are_named(changed: object) -> None:
    with pytest.raises(ValueError, match=r"parameters: expected (height|pin) in "):
        BlockPinFamily(TEMPLATE, (changed,))  # type: ignore[arg-type]


def test_levels_may_come_in_another_order() -> None:
    family = BlockPinFamily(TEMPLATE, (replace(FAMILY["pin"], levels=("round", "bar")),))
    assert family.model(np.array([0.0])).specimen.pin == "round"


def test_friction_of_a_block_that_sticks_everywhere_is_refused() -> None:
    with pytest.raises(ValueError, match="friction of a block that sticks to pin and base"):
        _of("r", "friction")


def test_a_row_that_is_no_block_is_refused() -> None:
    with pytest.raises(ValueError, match="height: expected a length above 0 mm, found -1"):
        _of("height")(np.array([-1.0]))


def test_field_points_in_mm_stay_where_they_are_and_those_by_number_move_with_the_block() -> None:
    given = replace(TEMPLATE, field_grid=((0.0, 2.0), (4.0, 2.4)))
    for template, share in ((given, 1.0), (replace(TEMPLATE, field_grid=(3, 2)), 2.75 / 2.5)):
        found = _of("height", template=template).model(np.array([2.75])).points()
        np.testing.assert_allclose(found, template.points() * [1.0, share])


def test_a_campaign_refuses_rows_that_are_no_block_before_it_runs_any(tmp_path: Path) -> None:
    template = replace(TEMPLATE, field_grid=((0.0, 2.0), (4.0, 2.4)))
    family, theta = _of("height", template=template), np.array([[2.6], [2.39], [2.5]])
    with pytest.raises(ValueError, match=r"theta: row 1: field_grid: .* found \[4.0, 2.4\]"):
        run_campaign(family, theta, tmp_path / "runs", parameters=family.parameters)
    assert not (tmp_path / "runs").exists()


def _key(template: BlockPinModel, levels: tuple[str, ...], level: str) -> str:
    pin = replace(FAMILY["pin"], levels=levels)
    parameters = (FAMILY["r"], pin)
    theta = np.array([[0.4, levels.index(level)]])
    family = BlockPinFamily(template, parameters)
    [key] = CampaignPlan(family, theta, Path("unused"), parameters).keys()
    return key


def test_a_point_has_one_key_whatever_the_order_of_the_levels() -> None:
    key = _key(TEMPLATE, ("bar", "round"), "bar")
    assert _key(TEMPLATE, ("round", "bar"), "bar") == key
    assert _key(TEMPLATE, ("round", "bar"), "round") != key


def test_a_level_more_runs_no_point_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    key = _key(TEMPLATE, ("bar", "round"), "round")
    pins = replace(FAMILY["pin"], levels=("cone", "bar", "round"))
    monkeypatch.setitem(FAMILY, "pin", pins)
    assert _key(TEMPLATE, pins.levels, "round") == key


def test_a_point_of_another_template_has_another_key() -> None:
    keys = {
        _key(template, ("bar", "round"), "bar")
        for template in (
            TEMPLATE,
            replace(TEMPLATE, cells=(4, 2, 2)),
            replace(TEMPLATE, specimen=replace(TEMPLATE.specimen, height=2.7)),
            replace(TEMPLATE, contact=Contact("slide", "stick")),
        )
    }
    assert len(keys) == 4


needs_sensitivities = pytest.mark.skipif(
    not hasattr(BlockPinModel, "parameter_names"), reason="the model has gradients in (r, s) only"
)


@pytest.mark.lasting
@needs_sensitivities
@pytest.mark.parametrize("contact", ["slide", "stick"])
def test_gradients_are_the_slopes_along_every_continuous_parameter(contact: str) -> None:
    level = float(FAMILY["contact"].levels.index(contact))
    family = BlockPinFamily(replace(TEMPLATE, travel=(0.2,)), ALL)
    row = np.array([0.4, 0.1, 50.0, 0.3, 2.7, 0.4, 0.0, level])
    response = family(row)
    rubs = ("friction",) if contact == "slide" else ()
    assert response.parameters == ("r", "s", "bulk", *rubs, "height", "fillet")
    for j, name in enumerate(response.parameters):
        column = [p.name for p in ALL].index(name)
        step = np.zeros(len(ALL))
        step[column] = 1e-5 * max(row[column], 1.0)
        ends = [family(row + sign * step).force for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * step[column])
        np.testing.assert_allclose(response.force_gradient[:, j], slope, rtol=2e-4, atol=1e-5)


def test_a_campaign_whose_columns_mean_something_else_to_the_family_is_refused() -> None:
    pin = replace(FAMILY["pin"], levels=tuple(reversed(FAMILY["pin"].levels)))
    family = BlockPinFamily(TEMPLATE, (FAMILY["r"], FAMILY["pin"]))
    with pytest.raises(ValueError, match=r"parameters: found .* expected those of the model"):
        CampaignPlan(family, np.zeros((1, 2)), Path("unused"), (FAMILY["r"], pin))


@pytest.mark.parametrize("names", [("s", "r"), ("height", "fillet"), ("r", "s", "bulk")])
def test_a_campaign_whose_columns_a_plain_model_would_take_for_r_and_s_is_refused(
    names: tuple[str, ...],
) -> None:
    parameters = tuple(FAMILY[name] for name in names)
    for model in (
        TEMPLATE,
        UniaxialModel(Bar(), (0.1,)),
        TensileModel(NotchedPlate(), (2, 2, 1), (1.0,)),
    ):
        with pytest.raises(ValueError, match=r"parameters: found .* expected those of the model"):
            CampaignPlan(model, np.full((1, len(names)), 0.4), Path("unused"), parameters)
        CampaignPlan(model, np.full((1, 2), 0.4), Path("unused"))


def test_a_family_that_asks_for_forces_is_refused_before_a_run() -> None:
    family = _of("height", template=replace(TEMPLATE, travel=(), force=(20.0,)))
    with pytest.raises(ValueError, match="simulate: expected a model with travels asked"):
        CampaignPlan(family, np.array([[2.6]]), Path("unused"), family.parameters)


def test_targets_and_counts_are_kept_as_plain_numbers_that_do_not_change() -> None:
    cells, asked = [3, 2, 2], tuple(np.array([0.1, 0.2], dtype=np.float32))
    model = replace(TEMPLATE, cells=cells, travel=asked)
    cells[0] = 5
    assert model.cells == (3, 2, 2) and hash(model) == hash(replace(model))
    assert [type(travel) for travel in model.travel] == [float, float]
    assert type(replace(TEMPLATE, travel=(1,)).travel[0]) is float
    grid, asked_for = [3, 2], ["r", "s"]
    plate = TensileModel(NotchedPlate(), (2, 2, 1), (1.0,), field_grid=grid)
    model = replace(TEMPLATE, field_grid=grid, sensitivities=asked_for)
    at_points = replace(TEMPLATE, field_grid=np.array([[1.0, 1.0], [3.0, 2.0]]))
    grid[0], asked_for[0] = -4, "t"
    assert plate.field_grid == model.field_grid == (3, 2) and model.sensitivities == ("r", "s")
    assert at_points.field_grid == ((1.0, 1.0), (3.0, 2.0))
    assert len({hash(plate), hash(model), hash(at_points)}) == 3
