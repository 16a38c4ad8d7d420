"""A forward model that remembers: every solve is kept on disk and never made twice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.study.context import Simulate
from calib.study.run_identity import run_identity
from fe.campaign import CampaignPlan, load_response_at, run_campaigns
from fe.campaign_parameters import RATIOS, Parameter
from fe.fingerprint import canonical_json
from fe.response import Array, Response
from fe.run_files import load_run, run_files, software_versions
from surrogate import named_gradient


@dataclass(frozen=True)
class StoredSimulate:
    """A forward model that keeps what it solved, one run after another; for the direct MAP."""

    simulate: Simulate
    store: Path
    also_in: tuple[Path, ...] = ()
    """other folders in which a run may be found"""
    parameters: tuple[Parameter, ...] = RATIOS
    """columns of a row"""

    def __call__(self, ratios: Array) -> Response:
        """The run at ratios (d,): from a folder, or solved and kept."""
        row = np.asarray(ratios, dtype=np.float64)[None]
        for store in (self.store, *self.also_in):
            found = load_response_at(self._plan(row, store))
            if found is not None:
                return self._named(found)
        # The runs that are there already go along, so that the manifest lists them all.
        asked = np.concatenate([*self._kept(row), row])
        [campaign] = run_campaigns([self._plan(asked, self.store)])
        return self._named(campaign.responses[-1])

    def _named(self, response: Response) -> Response:
        """With derivatives by all columns of a row, in their order; NaN where there is none."""
        wanted, found = [parameter.name for parameter in self.parameters], response.parameters
        return replace(
            response,
            force_gradient=named_gradient(response.force_gradient, found, wanted),
            displacement_gradient=named_gradient(response.displacement_gradient, found, wanted),
            parameters=tuple(wanted),
        )

    def _plan(self, theta: Array, store: Path) -> CampaignPlan:
        return CampaignPlan(
            self.simulate,
            theta,
            store,
            parameters=self.parameters,
            fingerprint=run_identity(self.simulate),
            max_failure_rate=1.0,
        )

    def _kept(self, row: Array) -> list[Array]:
        """Ratios (1, d) of the runs of this model in the store, in the order of solving.

        Those of another version of softcal are kept under other names, and would be solved anew.
        """
        model = canonical_json(self._plan(row, self.store).fingerprint)
        runs = [load_run(path) for path in run_files(self.store).values()]
        version = software_versions()["softcal"]
        return [
            run.theta[None]
            for run in runs
            if run.fingerprint == model and run.software["softcal"] == version
        ]
