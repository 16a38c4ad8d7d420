"""Sensitivities of the specimens without a pin, in material, contact and geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe import (
    Bar,
    Cylinder,
    CylinderModel,
    NotchedPlate,
    PenaltyLaw,
    Status,
    TensileModel,
    UniaxialModel,
)
from fe.materials import material
from fe.newton import NewtonOptions
from fe.steps import StepOptions

TIGHT = NewtonOptions(1e-11, max_move=1.0)
ONE_STEP = StepOptions(3.0, 3.0, 0.005)
"""longer than between the asked travels: what rubs depends on the steps"""
LAW = (0.3, 0.2, 0.05, 20.0)
"""C10, C01, C11, bulk modulus, MPa"""
STEPS = np.array([1.0, 0.125])
RELATIVE = 4e-3
"""largest change of a parameter, relative to its size"""
OF_DIMENSION = 5e-4
"""the same of a dimension: where the side rolls, third derivatives in the height are large"""


PENALTY = PenaltyLaw(500.0, 0.2)
"""that of the default at 30 mm, which derivatives in the height hold"""


def cylinder(ends: str, friction: float, travel=(1.0, 2.5, 4.0), **more) -> CylinderModel:
    return CylinderModel(
        Cylinder(),
        (2, 2),
        travel,
        ends,
        friction,
        n_point=5,
        penalty=PENALTY,
        newton=TIGHT,
        steps=ONE_STEP,
        **more,
    )


ROLLED = (*np.arange(2.0, 14.1, 2.0).tolist(), *np.arange(15.0, 17.1, 1.0).tolist())
MODELS = {
    "tension": UniaxialModel(Bar(2.0, 3.0, 1.5), (0.5, 1.8), newton=TIGHT),
    "compression": UniaxialModel(Bar(2.0, 3.0, 1.5), (0.5, 1.2), "compression", newton=TIGHT),
    "notched plate": TensileModel(
        NotchedPlate(), (2, 3, 1), (2.0, 4.0), field_grid=(3, 4), newton=TIGHT, steps=ONE_STEP
    ),
    "bonded": cylinder("bonded", 0.0),
    "slide": cylinder("slide", 0.0),
    "friction": cylinder("slide", 0.3),  # at 0.15 all ends slide, and the slip is idle
    "bonded, side on the plate": cylinder("bonded", 0.0, ROLLED),
    "bonded, side rubs": cylinder("bonded", 0.2, ROLLED),  # none about to slide: a kink
}
IDLE = {
    "bonded": {"contact_stiffness", "contact_ramp"},
    "slide": {"contact_stiffness", "contact_ramp"},
    "friction": {"contact_stiffness", "contact_ramp"},
}
"""what nothing depends on where the side does not touch the plate"""
OF_PENALTY = {"contact_stiffness": "stiffness", "contact_ramp": "ramp"}
OF_LAW = ("C10", "C01", "C11", "bulk")


def rubber(numbers=LAW):
    return material("mooney-rivlin-3", numbers[:-1], numbers[-1])


def names(model) -> tuple[str, ...]:
    return model.parameter_names(rubber())


def size(model, name: str) -> float:
    """What a change of the parameter is relative to, in its unit."""
    if name in OF_LAW:
        return LAW[OF_LAW.index(name)]
    if name in OF_PENALTY:
        return getattr(model.penalty, OF_PENALTY[name])
    if name == "contact_slip":
        return model.slip
    if name == "friction":
        return model.friction
    return 0.1 if name == "travel_zero" else getattr(model.specimen, name)


def moved(model, name: str, h: float):
    """Model and material with one parameter changed by h."""
    model = replace(model, sensitivities=())
    if name in OF_LAW:
        return model, rubber(tuple(np.array(LAW) + h * np.eye(4)[OF_LAW.index(name)]))
    if name == "travel_zero":
        model = replace(model, travel=tuple(t - h for t in model.travel))
    elif name in OF_PENALTY:
        value = getattr(model.penalty, OF_PENALTY[name]) + h
        model = replace(model, penalty=replace(model.penalty, **{OF_PENALTY[name]: value}))
    elif name == "contact_slip":
        model = replace(model, slip=model.slip + h)
    elif name == "friction":
        model = replace(model, friction=model.friction + h)
    else:
        value = getattr(model.specimen, name) + h
        model = replace(model, specimen=replace(model.specimen, **{name: value}))
    return model, rubber()


def remainders(model, base, name: str) -> np.ndarray:
    """(n_step_size, 2) remainders of forces and field in one parameter, relative."""
    j = base.parameters.index(name)
    found = []
    relative = OF_DIMENSION if hasattr(model.specimen, name) else RELATIVE
    for h in STEPS * relative * size(model, name):
        changed, law = moved(model, name, h)
        there = changed.respond(law)
        force = there.force - base.force - h * base.force_gradient[:, j]
        field = there.displacement - base.displacement - h * base.displacement_gradient[..., j]
        found.append(
            [
                np.linalg.norm(force) / np.linalg.norm(base.force),
                np.linalg.norm(field) / np.linalg.norm(base.displacement),
            ]
        )
    return np.array(found)


@pytest.mark.lasting
@pytest.mark.parametrize("case", MODELS)
def test_the_remainder_of_taylor_falls_with_the_square_in_every_parameter(case):
    model = MODELS[case]
    base = replace(model, sensitivities=names(model)).respond(rubber())
    assert base.status is Status.CONVERGED, base.message
    scale = np.linalg.norm(base.force), np.linalg.norm(base.displacement)
    for j, name in enumerate(base.parameters):
        change = np.array(
            [
                np.linalg.norm(base.force_gradient[:, j]) / scale[0],
                np.linalg.norm(base.displacement_gradient[..., j]) / scale[1],
            ]
        ) * size(model, name)
        if name in IDLE.get(case, set()):
            assert change.max() == 0.0
            continue
        assert change.max() > 1e-6, (name, change)
        left = remainders(model, base, name)
        for k, what in enumerate(("force", "field")):
            # where it is linear, as the force in the stiffness, rounding is all that is left
            if left[0, k] < 1e-8:
                assert left[0, k] < 1e-5 * max(change[k], 1e-4), (name, what, left[:, k], change)
                continue
            order = np.polyfit(np.log(STEPS), np.log(left[:, k]), 1)[0]
            assert order == pytest.approx(2.0, abs=0.15), (name, what, left[:, k])


@pytest.mark.parametrize("case", MODELS)
def test_the_adjoint_agrees_with_the_direct_derivatives(case):
    """Gradient of a sum of squares of what differs from data, in all parameters."""
    model = replace(MODELS[case], sensitivities=names(MODELS[case]))
    rng = np.random.default_rng(0)
    base = model.respond(rubber())
    data = base.displacement + 0.1 * rng.standard_normal(base.displacement.shape)
    force = base.force * 1.1
    found = model.objective_gradients(
        rubber(), lambda i, field, total: (field - data[i], total - force[i])
    )
    expected = (base.force - force)[:, None] * base.force_gradient
    expected += np.einsum("ipk,ipkj->ij", base.displacement - data, base.displacement_gradient)
    scale = np.abs(expected).max(axis=0)
    assert (np.abs(found - expected).max(axis=0) <= 1e-8 * scale).all()


@pytest.mark.parametrize("case", ["notched plate", "friction", "bonded, side rubs"])
def test_asking_for_sensitivities_does_not_change_the_solution(case):
    model = MODELS[case]
    with_all, without = (
        replace(model, sensitivities=asked).respond(rubber()) for asked in (names(model), ())
    )
    assert with_all.force.tobytes() == without.force.tobytes()
    assert with_all.displacement.tobytes() == without.displacement.tobytes()
    assert without.force_gradient.shape == (len(model.travel), 0)


@pytest.mark.lasting
@pytest.mark.parametrize("case", ["compression", "notched plate", "bonded", "friction"])
def test_at_asked_forces_travel_and_field_follow_every_parameter(case):
    """One asked force, met in one step; the zero of the travel only shifts the travel."""
    model = MODELS[case]
    force = (0.9 * float(model.respond(rubber()).force[0]),)
    model = replace(model, travel=(), force=force, steps=ONE_STEP, sensitivities=names(model))
    base = model.respond(rubber())
    assert base.status is Status.CONVERGED, base.message
    assert not base.force_gradient.any()
    for j, name in enumerate(base.parameters):
        field = base.displacement_gradient[..., j]
        if name == "travel_zero":
            np.testing.assert_allclose(base.travel_gradient[:, j], 1.0, rtol=1e-10)
            np.testing.assert_allclose(field, 0.0, atol=1e-10)
            continue
        h = 1e-4 * size(model, name)
        there = [
            changed.respond(law) for changed, law in (moved(model, name, k * h) for k in (1, -1))
        ]
        travel = (there[0].travel - there[1].travel) / (2 * h)
        np.testing.assert_allclose(
            base.travel_gradient[:, j], travel, rtol=1e-5, atol=1e-7 / size(model, name)
        )
        expected = (there[0].displacement - there[1].displacement) / (2 * h)
        tolerance = 1e-5 * np.abs(expected).max() + 1e-7 / size(model, name)
        np.testing.assert_allclose(field, expected, atol=tolerance)


def test_ratios_have_the_derivatives_of_the_specimen_too():
    model = replace(MODELS["friction"], sensitivities=("height", "r", "bulk_ratio", "friction"))
    ratios = np.array([0.4, 0.1])
    base = model(ratios)
    assert base.parameters == ("height", "r", "bulk_ratio", "friction")
    h = 1e-4

    def force(name: str, k: float) -> np.ndarray:
        if name == "r":
            return model(ratios + np.array([k * h, 0.0])).force
        if name == "height":
            changed = replace(model.specimen, height=model.specimen.height + k * h)
            return replace(model, specimen=changed)(ratios).force
        return replace(model, **{name: getattr(model, name) * (1.0 + k * h)})(ratios).force

    for j, name in enumerate(base.parameters):
        step = {"bulk_ratio": 200.0, "friction": 0.3}.get(name, 1.0) * 2.0 * h
        expected = (force(name, 1) - force(name, -1)) / step
        np.testing.assert_allclose(base.force_gradient[:, j], expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("case", "name"),
    [("slide", "friction"), ("tension", "height"), ("notched plate", "contact_ramp")],
)
def test_an_unknown_parameter_is_refused_with_those_there_are(case, name):
    with pytest.raises(
        ValueError, match=rf"sensitivities: expected names among .*, found '{name}'"
    ):
        replace(MODELS[case], sensitivities=(name,)).respond(rubber())
    with pytest.raises(ValueError, match="expected a tuple of names, found 'height'"):
        replace(MODELS[case], sensitivities="height")


def test_the_adjoint_wants_travels():
    model = replace(MODELS["tension"], travel=(), force=(1.0,))
    with pytest.raises(ValueError, match="force: expected asked travels for the adjoint"):
        model.objective_gradients(rubber(), lambda i, field, force: (field, force))
