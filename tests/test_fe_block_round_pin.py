"""The block under a round pin: equilibrium of forces, energy, scale, order, and a prototype."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fe.specimens.block_lines
from fe import BlockPin, BlockPinModel, Contact, Status
from fe.contact import PenaltyLaw
from fe.materials.material import mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.solid import Solid
from fe.specimens.block_lines import Dense, Thinning
from fe.steps import StepOptions

ROUND = BlockPin(pin="round")
RATIOS = np.array([0.4, 0.1])
CONTACTS = pytest.mark.parametrize(
    "contact", [("stick", "stick"), ("slide", "stick"), ("slide", "slide")], ids="-".join
)


def model(pin: str = "stick", base: str = "stick", **changes) -> BlockPinModel:
    m = BlockPinModel(
        ROUND,
        Contact(pin, base),
        (4, 2, 4),
        (0.2, 0.4),
        field_grid=(4, 3),
        newton=NewtonOptions(tolerance=1e-9),
    )
    return replace(m, **changes)


@CONTACTS
def test_the_base_carries_what_the_pin_presses(contact):
    m = model(*contact)
    states, outcome, _ = m.solve(RATIOS)
    assert outcome.reached == 0.4
    elements = m.discretise().elements
    solid = Solid(elements, mooney_rivlin_of_ratios(RATIOS, 1.0, 2.0 * m.bulk_ratio))
    not_top = elements.positions[:, 1] < m.specimen.height - 1e-9
    for state in states:
        _, _, nodal = solid.assemble(state.u, solid.consistent_pressure(state.u))
        assert nodal[not_top, 1].sum() == pytest.approx(state.pin_force, rel=1e-6)


@pytest.mark.lasting
@CONTACTS
def test_force_scales_with_kappa_and_field_does_not(contact):
    m = model(*contact)
    one, two = m.solve(RATIOS, 1.0)[0], m.solve(RATIOS, 0.037)[0]
    assert len(one) == len(two) == 2
    for a, b in zip(one, two, strict=True):
        assert b.pin_force == pytest.approx(0.037 * a.pin_force, rel=1e-9)
        np.testing.assert_allclose(b.u, a.u, atol=1e-9)


@pytest.mark.parametrize("contact", ["slide", "stick"])
def test_the_work_of_the_pin_is_stored(contact):
    m = model(contact, contact, travel=tuple(np.linspace(0.02, 0.4, 20)))
    states, _, _ = m.solve(RATIOS)
    force = np.array([0.0, *(s.pin_force for s in states)])
    work = np.trapezoid(force, np.array([0.0, *m.travel]))
    assert work == pytest.approx(states[-1].energy, rel=1e-3)


@pytest.mark.lasting
@CONTACTS
def test_a_round_pin_takes_less_force_than_a_bar_and_more_than_a_thinner_one(contact):
    specimens = (BlockPin(pin="round", pin_width=3.0), ROUND, BlockPin())
    one = {"travel": (0.2,)}
    thin, thick, bar = (model(*contact, specimen=s, **one)(RATIOS) for s in specimens)
    assert thin.status is thick.status is bar.status is Status.CONVERGED
    assert np.all(thin.force < thick.force)
    assert np.all(thick.force < bar.force)


@pytest.mark.parametrize("contact", [("stick", "stick"), ("slide", "slide")], ids="-".join)
def test_x_and_z_are_alike_under_a_round_pin(contact):
    m = model(*contact)
    states, _, _ = m.solve(RATIOS)
    at = m.discretise().elements.positions
    order = np.lexsort(np.round(at, 9).T)
    swapped = np.lexsort(np.round(at[:, [2, 1, 0]], 9).T)
    for state in states:
        np.testing.assert_allclose(state.u[swapped][:, [2, 1, 0]], state.u[order], atol=1e-7)


@pytest.mark.lasting
@pytest.mark.parametrize("contact", [("stick", "stick"), ("slide", "slide")], ids="-".join)
def test_sensitivities_match_central_differences(contact):
    m = model(*contact, travel=(0.1, 0.2), steps=StepOptions(largest=0.05))
    base, h = m(RATIOS), 1e-4
    for j, step in enumerate(np.eye(2) * h):
        plus, minus = m(RATIOS + step), m(RATIOS - step)
        force = (plus.force - minus.force) / (2 * h)
        np.testing.assert_allclose(base.force_gradient[:, j], force, rtol=2e-3)


@pytest.mark.lasting
def test_friction_of_the_base_lies_between_sliding_and_sticking():
    one = {"travel": (0.2,)}
    forces = [model("stick", base, **one)(RATIOS).force for base in ("slide", 0.3, "stick")]
    assert np.all(np.diff(forces, axis=0) > 0.0)


@pytest.mark.slow
def test_forces_of_an_independent_prototype(monkeypatch):
    """A prototype that glues nodes where this glues points.

    Same uniform mesh of 12 x 6 x 12 elements, material (r = 0.5, mu = 0.03 MPa) and penalty of
    20 N/mm3.
    """
    lines = fe.specimens.block_lines
    monkeypatch.setattr(lines, "GLUED_RIM", lines.Edge(0.7, Dense(peak=0.0, spread=1.0)))
    monkeypatch.setattr(lines, "STUCK_TO_ROUND", Thinning(front=0.0, top=0.0))
    m = model(
        cells=(12, 6, 12),
        travel=(0.6, 1.0, 1.4),
        penalty=PenaltyLaw(stiffness=20.0 / 0.03, ramp=1e-3),
        steps=StepOptions(largest=0.15),
        newton=NewtonOptions(),
    )
    force = 0.015 * m(np.array([0.5, 0.0])).force
    np.testing.assert_allclose(force, [0.956, 2.145, 4.228], rtol=0.02)
