"""A forward model that remembers: every solve is kept on disk and never made twice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.study.context import Simulate
from fe.campaign import CampaignPlan, load_response_at, run_campaigns
from fe.fingerprint import canonical_json
from fe.response import Array, Response
from fe.run_files import load_run, run_files


@dataclass(frozen=True)
class StoredSimulate:
    """A forward model that keeps what it solved, one run after another; for the direct MAP."""

    simulate: Simulate
    store: Path
    also_in: tuple[Path, ...] = ()
    """other folders in which a run may be found"""

    def __call__(self, ratios: Array) -> Response:
        """The run at ratios (2,): from a folder, or solved and kept."""
        row = np.asarray(ratios, dtype=np.float64)[None]
        for store in (self.store, *self.also_in):
            found = load_response_at(CampaignPlan(self.simulate, row, store))
            if found is not None:
                return found
        # The runs that are there already go along, so that the manifest lists them all.
        asked = np.concatenate([*self._kept(row), row])
        plan = CampaignPlan(self.simulate, asked, self.store, max_failure_rate=1.0)
        [campaign] = run_campaigns([plan])
        return campaign.responses[-1]

    def _kept(self, row: Array) -> list[Array]:
        """Ratios (1, 2) of the runs of this model in the store, in the order of solving."""
        model = canonical_json(CampaignPlan(self.simulate, row, self.store).fingerprint)
        runs = [load_run(path) for path in run_files(self.store).values()]
        return [run.theta[None] for run in runs if run.fingerprint == model]
