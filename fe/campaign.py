"""Campaigns: a simulation at every point of a design, each kept in one file and never lost."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fe.campaign_parameters import RATIOS, Parameter, checked_theta
from fe.campaign_result import Campaign, is_reached
from fe.executors import MapFn, WorkerDied, serial_map
from fe.fingerprint import canonical_json
from fe.fingerprint import fingerprint as fingerprint_of
from fe.manifest import write_manifest
from fe.response import Array, Response
from fe.run_files import KeptRun, keep_run, load_run, run_files, run_key

Simulate = Callable[[Array], Response]
Progress = Callable[[int, int], None]


class CampaignFailed(RuntimeError):  # noqa: N818 - says what happened
    """More runs failed than a surrogate may be built without."""

    def __init__(self, message: str, n_failed: int, n_done: int, n_total: int) -> None:
        super().__init__(message)
        self.n_failed = n_failed
        self.n_done = n_done
        self.n_total = n_total

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), (str(self), self.n_failed, self.n_done, self.n_total)


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """What is to be run and where it is kept.

    Raises ValueError for a model with forces asked, for `parameters` other than the attribute
    `columns` (or `parameters`) of a model that has one, for a design that `checked_theta` refuses
    or a method `check_rows(theta)` of the model, if it has one, for a store that is a file, and for
    a fingerprint or `design` that does not consist of finite JSON values, TypeError where no
    fingerprint is given for a model that is no dataclass.
    """

    simulate: Simulate
    """takes a row of theta; picklable, to run in other processes"""
    theta: Array
    """(n, d) design in the units of the parameters; a factor as the index of its level"""
    store: Path
    """folder of the run files and their manifest"""
    parameters: tuple[Parameter, ...] = RATIOS
    """the d columns of theta"""
    fingerprint: Mapping[str, object] = field(default_factory=dict)
    """JSON values: all that a result depends on besides theta; default: the model's fields"""
    design: Mapping[str, object] = field(default_factory=dict)
    """JSON values: how theta was made, its seed among them; kept in the manifest"""
    max_failure_rate: float = 0.2
    """share of the runs, 0 to 1, that may fail before the campaign stops"""

    def __post_init__(self) -> None:
        if not 0.0 <= self.max_failure_rate <= 1.0:
            raise ValueError(
                f"max_failure_rate: expected a share from 0 to 1, found {self.max_failure_rate}"
            )
        forces = getattr(self.simulate, "force", None)
        if isinstance(forces, tuple) and forces:
            raise ValueError(
                "simulate: expected a model with travels asked, which all runs share, found forces"
            )
        for name in ("columns", "parameters"):
            own = getattr(self.simulate, name, None)
            if isinstance(own, tuple) and own and isinstance(own[0], Parameter):
                _check_same(own, self.parameters)
        object.__setattr__(self, "theta", checked_theta(self.theta, self.parameters))
        check_rows = getattr(self.simulate, "check_rows", None)
        if callable(check_rows):
            check_rows(self.theta)
        object.__setattr__(self, "store", Path(self.store))
        if self.store.exists() and not self.store.is_dir():
            raise ValueError(f"store: expected a folder, found the file {self.store}")
        if not self.fingerprint:
            object.__setattr__(self, "fingerprint", fingerprint_of(self.simulate))
        for what in ("fingerprint", "design"):
            values = json.loads(canonical_json(getattr(self, what), what))
            object.__setattr__(self, what, values)

    def keys(self) -> list[str]:
        """Names of the n runs."""
        return [run_key(row, self.parameters, self.fingerprint) for row in self.theta]


def run_campaign(
    simulate: Simulate,
    theta: Array,
    store: str | Path,
    *,
    parameters: tuple[Parameter, ...] = RATIOS,
    fingerprint: Mapping[str, object] | None = None,
    design: Mapping[str, object] | None = None,
    map_fn: MapFn | None = None,
    progress: Progress | None = None,
    max_failure_rate: float = 0.2,
) -> Campaign:
    """Run `simulate` for each row of `theta` (n, d), reusing the runs that `store` holds.

    See `CampaignPlan` for the arguments and `run_campaigns` for what happens and is raised.
    """
    plan = CampaignPlan(
        simulate, theta, Path(store), parameters, fingerprint or {}, design or {}, max_failure_rate
    )
    [campaign] = run_campaigns([plan], map_fn, progress)
    return campaign


def run_campaigns(
    plans: Sequence[CampaignPlan],
    map_fn: MapFn | None = None,
    progress: Progress | None = None,
) -> list[Campaign]:
    """Run what is missing of all plans in one map, so that no core waits between them.

    Give the plans with the longest runs first, so that none waits at the end either. A run is
    known by the hash of its parameters and the fingerprint, so a changed design reuses the points
    that it shares with the old one. Each result is written atomically as it arrives: a campaign
    that was killed goes on where it was, and ends with the same numbers. `progress(done, total)`
    is called at the start and after each run, with the runs of all plans.

    Raises ValueError for a file in a store that is damaged or foreign (naming it) and for plans of
    one store, CampaignFailed once more than `max_failure_rate` of all runs of a plan have failed,
    TypeError for a result that is no `Response`, and whatever a simulation raises (numerical
    failure is a status, not an exception), with a note that names the run. What was done before is
    kept.
    """
    if len({plan.store.resolve() for plan in plans}) < len(plans):
        raise ValueError("plans: expected a store of its own for each, found one of several")
    ledgers = [_Ledger.of(plan) for plan in plans]
    items = [(which, row) for which, ledger in enumerate(ledgers) for row in ledger.missing()]
    models = _OneOf(
        tuple(plan.simulate for plan in plans),
        tuple(str(plan.store) for plan in plans),
        tuple(plan.parameters for plan in plans),
    )
    rows = [(which, row, plans[which].theta[row]) for which, row in items]
    results = (map_fn or serial_map)(models, rows) if rows else iter(())
    try:
        for ledger in ledgers:
            ledger.write_manifest()
            ledger.check_failures()
        _tell(progress, ledgers)
        for position, response in results:
            which, row = items[position]
            ledgers[which].keep(row, response)
            _tell(progress, ledgers)
            ledgers[which].check_failures()
    except WorkerDied as error:
        if error.index is not None:
            error.add_note(models.named(rows[error.index]))
        raise
    finally:
        # The traceback of an interrupt would keep the iterator, and so its workers, alive.
        close = getattr(results, "close", None)
        if close is not None:
            close()
        for ledger in ledgers:
            ledger.write_manifest()
    return [ledger.campaign() for ledger in ledgers]


def load_campaign(plan: CampaignPlan) -> Campaign:
    """A finished campaign; runs and writes nothing.

    Raises ValueError when runs are missing, damaged or foreign.
    """
    ledger = _Ledger.of(plan)
    missing = ledger.missing()
    if missing:
        raise ValueError(
            f"{plan.store}: expected all {len(plan.theta)} runs of the campaign, found "
            f"{len(missing)} missing; run the campaign first"
        )
    return ledger.campaign()


def list_campaign(plan: CampaignPlan) -> None:
    """Write the manifest of what the store holds of a plan; runs nothing.

    Raises ValueError when runs are damaged or foreign.
    """
    _Ledger.of(plan).write_manifest()


def load_response_at(plan: CampaignPlan, row: int = 0) -> Response | None:
    """The result of one row of a plan when its store has it, else None."""
    path = run_files(plan.store).get(plan.keys()[row])
    return None if path is None else load_run(path).response


@dataclass(frozen=True)
class _OneOf:
    """Runs the model with the given index at the given row.

    Raises what the model raises, with a note that says of which run, and TypeError for a result
    that is no `Response`.
    """

    models: tuple[Simulate, ...]
    stores: tuple[str, ...]
    parameters: tuple[tuple[Parameter, ...], ...]

    def __call__(self, item: tuple[int, int, Array]) -> Response:
        which, _, theta = item
        try:
            found: object = self.models[which](theta.copy())  # theirs to write to
            if not isinstance(found, Response):
                raise TypeError(f"simulate: expected a Response, found {type(found).__name__}")
        except Exception as error:
            error.add_note(self.named(item))
            raise
        return found

    def named(self, item: tuple[int, int, Array]) -> str:
        """Which run an item is, in words."""
        which, row, theta = item
        each = zip(self.parameters[which], theta, strict=True)
        values = ", ".join(f"{p.name} = {p.text(value)}" for p, value in each)
        return f"in run {row} of {self.stores[which]}: {values}"


@dataclass(frozen=True, eq=False)
class _Ledger:
    """What a store holds of a plan; grows as results arrive."""

    plan: CampaignPlan
    keys: list[str]
    runs: dict[str, tuple[Path, KeptRun]]
    unused: list[Path]
    n_reused: int

    @classmethod
    def of(cls, plan: CampaignPlan) -> _Ledger:
        keys = plan.keys()
        paths = run_files(plan.store)
        runs = {key: (paths[key], load_run(paths[key])) for key in keys if key in paths}
        unused = [path for key, path in paths.items() if key not in set(keys)]
        return cls(plan, keys, runs, unused, sum(key in runs for key in keys))

    def missing(self) -> list[int]:
        """Rows to run: the first of each key that is not there (equal points are run once)."""
        first: dict[str, int] = {}
        for row, key in enumerate(self.keys):
            if key not in self.runs:
                first.setdefault(key, row)
        return list(first.values())

    def keep(self, row: int, response: Response) -> None:
        plan = self.plan
        self.runs[self.keys[row]] = keep_run(
            plan.store, row, plan.theta[row], plan.parameters, plan.fingerprint, response
        )

    def done(self) -> list[Response]:
        return [self.runs[key][1].response for key in self.keys if key in self.runs]

    def check_failures(self) -> None:
        """Stop as soon as too many have failed for the whole campaign.

        Failures are held against the number of all runs, not of those done: whether a campaign
        fails then does not depend on the order in which its runs end.
        """
        done, total, rate = self.done(), len(self.keys), self.plan.max_failure_rate
        failed = [response for response in done if not is_reached(response)]
        if len(failed) > rate * total:
            names = ", ".join(parameter.name for parameter in self.plan.parameters)
            raise CampaignFailed(
                f"{self.plan.store.name}: {len(failed)} of {total} runs failed ({len(done)} done), "
                f"more than the {rate:.0%} allowed; one stopped at {failed[0].reached:.3g} mm: "
                f"{failed[0].message}; narrow the range of {names}, change the mesh or lower the "
                "largest travel",
                n_failed=len(failed),
                n_done=len(done),
                n_total=total,
            )

    def write_manifest(self) -> None:
        """Write what the store holds of the plan so far, in the order of its rows."""
        plan = self.plan
        plan.store.mkdir(parents=True, exist_ok=True)
        kept = [self.runs.get(key) for key in self.keys]
        write_manifest(
            plan.store,
            plan.theta,
            plan.parameters,
            plan.fingerprint,
            plan.design,
            kept,
            self.unused,
        )

    def campaign(self) -> Campaign:
        plan = self.plan
        return Campaign(
            plan.theta, tuple(self.done()), self.n_reused, plan.parameters, tuple(self.unused)
        )


def _tell(progress: Progress | None, ledgers: Sequence[_Ledger]) -> None:
    if progress is not None:
        done = sum(len(ledger.done()) for ledger in ledgers)
        progress(done, sum(len(ledger.keys) for ledger in ledgers))


def _check_same(own: tuple[Parameter, ...], stated: tuple[Parameter, ...]) -> None:
    """Raise ValueError where columns mean something else to a model than to its campaign."""
    by_model, by_campaign = ([(p.name, p.levels) for p in each] for each in (own, stated))
    if by_model != by_campaign:
        raise ValueError(
            f"parameters: found {by_campaign}, expected those of the model, {by_model}"
        )
