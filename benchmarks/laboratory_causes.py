"""What in a virtual test makes contact and forces of all samples err alike, one cause at a time.

    python -m benchmarks.laboratory_causes [--samples 100] [--seed 2500]

Each line: error of the contact by the force and of the one used (found less true, micrometres;
positive is too deep) and of the forces at the travels used (mN), mean and standard error over the
samples.  Test machines alone, no cameras.  Last in a line: how many mean forces of 16 samples
differ from the truth at 5 %, and of how many.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import replace
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from benchmarks.verify_data import TRUTH
from calib.data.dataset import Dataset
from calib.data.qc import machine_test as tested
from calib.data.qc.averaging import mean_force
from calib.data.qc.contact import SMALLEST_SD, Contact
from calib.data.qc.experiment_file import Machine, Protocol
from calib.data.qc.sample import HOLDS_OF_FORCE, REACH
from calib.data.readers import MachineRecord
from calib.virtual import BlockTruth, LaboratorySettings, Rubber, TruthResponse, solve_truth
from calib.virtual.agreement import force_agreement
from calib.virtual.machine_run import run_machine
from fe.response import Array

PROTOCOL = Protocol()
MEAN_OF = 16


class Variant(NamedTuple):
    """A laboratory with one cause switched off, or another estimate of the contact."""

    name: str
    settings: LaboratorySettings
    contact: str = "as analysed"
    """or "true", or "ways down": without the fit of recovery"""
    holds: int = HOLDS_OF_FORCE
    """of the polynomial that brings forces to the nominal travels"""


def variants() -> tuple[Variant, ...]:
    """As is, then one thing changed at a time."""
    lab, rubber = LaboratorySettings(), Rubber()
    elastic = replace(rubber, relaxing_shares=(), relaxing_s=())
    even = replace(rubber, first_cycle_excess=0.0)

    def machine(**changes: float) -> LaboratorySettings:
        return replace(lab, machine=replace(lab.machine, **changes))

    return (
        Variant("as is", lab),
        Variant("ways down alone", lab, "ways down"),
        Variant(" no relaxation", replace(lab, rubber=elastic), "ways down"),
        Variant(" no softening", replace(lab, rubber=even), "ways down"),
        Variant(" no drift", machine(force_drift_N=0.0), "ways down"),
        Variant(" no rounding", machine(force_step_N=1e-6, travel_step_mm=1e-6), "ways down"),
        Variant(" no noise", machine(force_noise_N=1e-4, travel_noise_mm=1e-6), "ways down"),
        Variant("no noise", machine(force_noise_N=1e-4, travel_noise_mm=1e-6)),
        Variant("true contact, three holds", lab, "true", 3),
        Variant("true contact", lab, "true"),
    )


def measured(
    truth: TruthResponse, variant: Variant, samples: int, seed: int
) -> tuple[Array, Array, Array]:
    """(samples, 2) errors of contact, mm, (samples, n_step) forces and their errors, N."""
    rng, settings = np.random.default_rng(seed), variant.settings
    machine = Machine(compliance_mm_per_N=settings.machine.compliance_mm_per_N)
    contacts, forces, errors = [], [], []
    for _ in range(samples):
        stiffness = float(np.exp(settings.placing.stiffness_sd * rng.standard_normal()))
        run = run_machine(truth, stiffness, settings, rng)
        record = MachineRecord("x", run.time, run.force, run.position, "compression")
        true = settings.protocol.slack_mm - run.contact
        known = Contact(true, 1e-9, 0.0, true, 1e-9)
        with ExitStack() as stack:
            if variant.contact == "true":
                stack.enter_context(
                    patch.object(tested, "contact_after_recovery", lambda *_, known=known: known)
                )
            elif variant.contact == "ways down":
                stack.enter_context(
                    patch.object(tested, "contact_after_recovery", lambda *given: given[-1])
                )
            test = tested.machine_test(record, PROTOCOL, machine)
        _, travel, force = test.loaded()
        reach = REACH * PROTOCOL.increment_mm
        forces.append(tested.at_travel(travel, force, PROTOCOL.travel, reach, variant.holds))
        errors.append(forces[-1] - truth.force_at(PROTOCOL.travel, stiffness))
        contacts.append((test.contact.by_force - true, test.contact.travel - true))
    return np.array(contacts), np.array(forces), np.array(errors)


def below(truth: TruthResponse, forces: Array) -> tuple[int, int]:
    """How many means of `MEAN_OF` of the forces (n, n_step) [N] have p below 0.05, and of how many.

    With the weight that noise of the force leaves to it in the contact, 0.7.
    """
    groups = forces[: len(forces) // MEAN_OF * MEAN_OF].reshape(-1, MEAN_OF, forces.shape[1])
    few = 0
    for group in groups:
        mean, covariance = mean_force(group)
        sd = np.sqrt(np.diag(covariance))
        data = Dataset(
            "x", True, PROTOCOL.travel, mean, sd, MEAN_OF, None, covariance,
            travel_zero_sd=0.7 * SMALLEST_SD,
        )  # fmt: skip
        few += force_agreement(data, truth).p < 0.05
    return few, len(groups)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2500)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="lines")
    options = parser.parse_args()
    truth = solve_truth(BlockTruth(), TRUTH)
    for variant in variants():
        if options.only and variant.name.strip() not in options.only:
            continue
        contacts, forces, errors = measured(truth, variant, options.samples, options.seed)
        all_errors = 1e3 * np.hstack([contacts, errors])
        mean, se = all_errors.mean(axis=0), all_errors.std(axis=0, ddof=1) / len(errors) ** 0.5
        cells = " ".join(f"{m:6.1f} ({s:.1f})" for m, s in zip(mean, se, strict=True))
        print(f"{variant.name:28s} {cells}; p < 0.05: {below(truth, forces)}", flush=True)


if __name__ == "__main__":
    main()
