"""Rounds that verify a maximum: where direct FE contradicts the emulator, its runs train it anew.

After the stage `map`, a hypothesis whose two maxima lie more than 0.2 posterior SDs apart
(`calib.study.maxima_table`) gets the FE runs of that search, at the FE maximum and on the way to
it, as training runs with their sensitivities; the modes of its fields are made to leave out less.
The stages from `refine` on then see another input and are done again, up to
`verification.max_rounds` times. What was found and added is kept in verification.json; it belongs
to all that the first maximum was made from, and is dropped when any of that changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from calib.study.artifacts import hash_of_file, read_json, write_json
from calib.study.context import Context
from calib.study.maxima_table import is_verified, largest_difference
from calib.study.refinement import APART
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import campaign_folder
from calib.study.simulations import StoredSimulate
from calib.study.train_stage import DIAGNOSTICS
from calib.study.training_runs import SAME_POINT
from calib.study.unknowns import design_box, parameters_of
from fe.campaign_result import Campaign
from fe.response import Array

FILE = "verification.json"
MAP = "map.json"


def map_folder(out: Path, hypothesis: str) -> Path:
    """Where the FE solves of the search for the maximum are kept."""
    return out / "map" / hypothesis


def load_rounds(out: Path) -> list[dict[str, Any]]:
    """Rounds so far, each hypothesis -> what was found and added; none without verification.json.

    Raises ValueError when the file is damaged.
    """
    path = out / FILE
    rounds: list[dict[str, Any]] = read_json(path)["rounds"] if path.is_file() else []
    return rounds


def drop_foreign(context: Context, base: str) -> None:
    """Forget rounds of other inputs than `base` stands for, and those beyond the study's number.

    So that a study ends with the same numbers in a folder with a past as in an empty one. The FE
    runs stay where they are.
    """
    path = context.out / FILE
    if not path.is_file():
        return
    kept = read_json(path)
    rounds = kept["rounds"][: context.study.verification.max_rounds]
    if kept["base"] != base or not rounds:
        path.unlink()
    elif len(rounds) < len(kept["rounds"]):
        write_json(path, kept | {"rounds": rounds})


def added(out: Path, hypothesis: Hypothesis, dimension: int) -> Array:
    """(k, d) points at which runs were added in the rounds so far, in that order."""
    rows = [row for each in load_rounds(out) for row in each[hypothesis.name]["added"]]
    return np.asarray(rows, dtype=float).reshape(-1, dimension)


def n_rounds(out: Path, hypothesis: Hypothesis) -> int:
    """Rounds so far in which runs were added for a hypothesis."""
    return sum(len(each[hypothesis.name]["added"]) > 0 for each in load_rounds(out))


def inputs(context: Context) -> dict[str, object]:
    """What the stage `refine` depends on besides: the points added, if there are any."""
    found = [each[h.name]["added"] for each in load_rounds(context.out) for h in _all(context)]
    return {"runs at the maximum": found} if any(found) else {}


def refinement_is_kept(out: Path, refinement: Path) -> bool:
    """Whether `refinement` is the file that the rounds so far began with."""
    path = out / FILE
    if not (path.is_file() and refinement.is_file()):
        return False
    return bool(read_json(path)["refinement"] == hash_of_file(refinement))


def campaigns_added(context: Context, hypothesis: Hypothesis) -> tuple[Campaign, ...]:
    """The runs added for one hypothesis, as one campaign; none before there is a round.

    They were solved by the search for the maximum; one that is missing is solved again.
    """
    parameters = parameters_of(context.study, hypothesis)
    points = added(context.out, hypothesis, len(parameters))
    if not len(points):
        return ()
    folders = (campaign_folder(context.out, hypothesis),)
    store = map_folder(context.out, hypothesis.name)
    simulate = StoredSimulate(context.sampling_model(hypothesis), store, folders, parameters)
    responses = tuple(simulate(row) for row in points)
    return (Campaign(points, responses, n_reused=len(points), parameters=parameters),)


def add_round(context: Context, base: str, refinement: Path, trained_at: dict[str, Array]) -> bool:
    """Choose the runs of one more round by map.json; False when there is nothing left to do.

    `trained_at` are the points of all training runs by hypothesis. That is so when all are
    verified, when the study's number of rounds is reached, or when the emulator has learnt from
    every run already. `base` stands for what the first maximum was made from.
    """
    maps, rounds = read_json(context.out / MAP), load_rounds(context.out)
    limit = context.study.verification.max_rounds
    if all(is_verified(found) for found in maps.values()) or len(rounds) >= limit:
        return False
    diagnostics = read_json(context.out / DIAGNOSTICS)
    facts: dict[str, dict[str, Any]] = {}
    for hypothesis in _all(context):
        name, found = hypothesis.name, maps[hypothesis.name]
        points = np.zeros((0, trained_at[name].shape[1]))
        if not is_verified(found):
            points = _chosen(found, trained_at[name], design_box(context.study, hypothesis))
        facts[name] = {
            "n_train": diagnostics[name]["n_train"],
            "difference_sd": largest_difference(found),
            "n_fe_solves": found["n_fe_solves"],
            "verified": is_verified(found),
            "added": points,
        }
    if not any(len(each["added"]) for each in facts.values()):
        return False
    for name, each in facts.items():
        if len(each["added"]):
            context.echo(
                f"  {name}: {len(each['added'])} of the runs there train the emulator anew "
                f"(round {len(rounds) + 1} of at most {limit})"
            )
    kept = {"base": base, "refinement": hash_of_file(refinement), "rounds": [*rounds, facts]}
    write_json(context.out / FILE, kept)
    return True


def _chosen(found: Mapping[str, Any], trained_at: Array, box: Array) -> Array:
    """(k, d) points of a search to learn from: the FE maximum, and others that are apart.

    FE forces are rough over short distances, so that runs close to each other contradict each
    other's slopes (`calib.study.refinement.APART`); the maximum itself is taken however near.
    """
    dimension = trained_at.shape[1]
    if found["fe_x"] is None:
        return np.zeros((0, dimension))
    maximum = np.asarray(found["fe_x"], dtype=float)[1 : 1 + dimension]
    others = np.asarray(found.get("solved_at", ()), dtype=float).reshape(-1, dimension)
    extent = np.ptp(box, axis=1)
    chosen = trained_at
    for point, apart in [(maximum, SAME_POINT), *((other, APART) for other in others)]:
        distance = (np.abs(chosen - point) / extent).max(axis=1)
        if (distance > apart).all():
            chosen = np.vstack([chosen, point])
    return chosen[len(trained_at) :]


def _all(context: Context) -> tuple[Hypothesis, ...]:
    return context.study.hypotheses
