"""Several campaigns through one pool of processes, so that no core waits at the end of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.study.context import Simulate, fingerprint
from fe.campaign import Campaign, is_reached, keep_run, run_campaign, run_key
from fe.executors import MapFn
from fe.response import Array, Response, load_response


@dataclass(frozen=True)
class RunSet:
    """Runs of one model that are kept in one folder."""

    simulate: Simulate
    ratios: Array
    """(n, 2) ratios (r, s)"""
    store: Path
    max_failure_rate: float = 0.2

    def campaign(self) -> Campaign:
        """All runs, from the store as far as they are there."""
        return run_campaign(
            self.simulate,
            self.ratios,
            self.store,
            fingerprint=fingerprint(self.simulate),
            max_failure_rate=self.max_failure_rate,
        )

    def missing(self) -> list[tuple[int, Array]]:
        """Rows without a run in the store, as (row number, ratios (2,)), equal ones once."""
        known = {path.stem.rpartition("_")[2] for path in self.store.glob("run_*.npz")}
        rows: dict[str, tuple[int, Array]] = {}
        for index, row in enumerate(self.ratios):
            key = run_key(row, fingerprint(self.simulate))
            if key not in known:
                rows.setdefault(key, (index, row))
        return list(rows.values())


def run_together(
    sets: Sequence[RunSet],
    map_fn: MapFn,
    progress: Callable[[int, int], None] | None = None,
) -> list[Campaign]:
    """Run all sets in one map over processes and return their campaigns in order.

    Give the sets with the longest runs first, so that no core waits at the end. Every run is kept
    in its store as it arrives. `progress(done, total)` counts the runs of all sets.
    Raises what `fe.campaign.run_campaign` raises.
    """
    items = [(i, *row) for i, run_set in enumerate(sets) for row in run_set.missing()]
    total = sum(len(s.ratios) for s in sets)
    failed = [0] * len(sets)
    models = _Any(tuple(s.simulate for s in sets))
    results = map_fn(models, [(i, x) for i, _, x in items]) if items else iter(())
    try:
        if progress is not None:
            progress(total - len(items), total)
        for done, (position, response) in enumerate(results, start=1):
            which, index, ratios = items[position]
            run_set = sets[which]
            run_set.store.mkdir(parents=True, exist_ok=True)
            keep_run(run_set.store, index, ratios, fingerprint(run_set.simulate), response)
            if progress is not None:
                progress(total - len(items) + done, total)
            failed[which] += not is_reached(response)
            if failed[which] > run_set.max_failure_rate * len(run_set.ratios):
                break  # the campaign below says so
    finally:
        close = getattr(results, "close", None)
        if close is not None:
            close()
    return [run_set.campaign() for run_set in sets]


def load_run(store: Path, simulate: Simulate, ratios: Array) -> Response | None:
    """The run of a model at ratios (2,) that a store holds, or None."""
    key = run_key(np.asarray(ratios, dtype=np.float64), fingerprint(simulate))
    found = sorted(store.glob(f"run_*_{key}.npz"))
    return load_response(found[0]) if found else None


@dataclass(frozen=True)
class StoredSimulate:
    """A forward model that keeps what it solved, one run after another; for the direct MAP."""

    simulate: Simulate
    store: Path
    also_in: tuple[Path, ...] = ()
    """other folders in which a run may be found"""

    def __call__(self, ratios: Array) -> Response:
        """The run at ratios (2,): from a folder, or solved and kept."""
        for store in (self.store, *self.also_in):
            found = load_run(store, self.simulate, ratios)
            if found is not None:
                return found
        # The runs that are there already go along, so that the manifest lists them all.
        asked = np.vstack([*self._kept(), np.asarray(ratios, dtype=np.float64)[None]])
        campaign = run_campaign(
            self.simulate,
            asked,
            self.store,
            fingerprint=fingerprint(self.simulate),
            max_failure_rate=1.0,
        )
        return campaign.responses[-1]

    def _kept(self) -> list[Array]:
        """Ratios (1, 2) of the runs of this model in the store, in the order of solving."""
        kept = []
        for path in sorted(self.store.glob("run_*.npz")):
            with np.load(path, allow_pickle=False) as stored:
                ratios = stored["ratios"]
            if path.stem.endswith(run_key(ratios, fingerprint(self.simulate))):
                kept.append(ratios[None])
        return kept


@dataclass(frozen=True)
class _Any:
    """Runs the model with the given index."""

    models: tuple[Simulate, ...]

    def __call__(self, item: tuple[int, Array]) -> Response:
        return self.models[item[0]](item[1])
