"""Tables of the posterior's maximum by emulator and by direct FE; whether the two agree.

`maps` is map.json and `found` a hypothesis' part of it; `rounds` are those of verification.json.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from calib.study.tables import Table, number

X_NAMES = ("ln kappa [MPa]", "r", "s")
CONFIRMED_SD = 0.2
"""largest difference of the maxima, posterior SDs, that verifies the emulator's"""


def largest_difference(found: Mapping[str, Any]) -> float | None:
    """Of the two maxima over all unknowns, posterior SDs; None without one by direct FE.

    Where the search by direct FE was stopped, the maximum is the one that it foretells.
    """
    apart = found["foretold_sd_x"]
    known = [abs(value) for value in apart if value is not None]
    return max(known) if known and len(known) == len(apart) else None


def is_verified(found: Mapping[str, Any]) -> bool:
    """Whether direct FE confirms the emulator's maximum."""
    difference = largest_difference(found)
    return difference is not None and difference <= CONFIRMED_SD


def confirmation(name: str, found: Mapping[str, Any]) -> str:
    """Whether direct FE confirms the emulator's maximum, as a sentence."""
    if is_verified(found):
        return f" {name}: direct FE confirms the emulator's maximum within {CONFIRMED_SD} SD."
    return f" {name}: not verified, since {unconfirmed(largest_difference(found))}."


def unconfirmed(difference: float | None) -> str:
    """What keeps a maximum from being verified, by the largest difference of the two."""
    if difference is None:
        return "direct FE found no maximum"
    return (
        f"direct FE does not confirm the emulator's maximum within {CONFIRMED_SD} SD; they lie "
        f"{difference:.2g} SD apart"
    )


def map_table(maps: Mapping[str, Any]) -> Table:
    """How the FE model moved the maximum; `maps` is map.json."""
    rows = []
    named = {name: found.get("x", X_NAMES) for name, found in maps.items()}
    columns = list(dict.fromkeys(n.removesuffix(" [MPa]") for own in named.values() for n in own))
    for name, found in maps.items():
        names = [column.removesuffix(" [MPa]") for column in named[name]]
        by_name = dict(zip(names, found["difference_sd_x"], strict=True))
        values = [by_name.get(column) for column in columns]
        off = ["-" if value is None else f"{value:+.3f}" for value in values]
        gradient = found["projected_gradient_fe"]
        slope = None if gradient is None else max(abs(value) for value in gradient)
        rows.append((name, *off, number(slope, 2), str(found["n_fe_solves"]), found["status"]))
    return Table(
        "Maximum of the posterior (MAP): direct FE minus emulator, in posterior SDs",
        (
            "hypothesis",
            *(f"{column} [SD]" for column in columns),
            "slope used * SD [-]",
            "FE solves",
            "search",
        ),
        tuple(rows),
        f"Same density in ({', '.join(columns)}): same prior, data and errors, the emulator's "
        "included. Where a search converged, the maximum by direct FE is the one that its values "
        "and the slopes used foretell at the best point solved. Direct FE has the mesh of the "
        "emulator's runs, so the difference holds no discretisation error. A search that did not "
        "converge leaves its best point, not a maximum, and confirms the emulator's by what values "
        "and slopes foretell within 4 SD of that point. "
        + " ".join(f"{name}: {found['message']}." for name, found in maps.items())
        + "".join(confirmation(name, found) for name, found in maps.items())
        + "".join(
            f" {name}: the emulator was trained at this point, so the agreement there is by "
            "construction."
            for name, found in maps.items()
            if found["fe_is_training_run"]
        )
        + "".join(
            f" {name}: the slopes of the direct model there were not known or led to a worse "
            "point; those used are the emulator's with secants between direct solves."
            for name, found in maps.items()
            if found["by_secants"]
        ),
    )


def laplace_table(maps: Mapping[str, Any]) -> Table | None:
    """The normal density of the maximum beside the samples; `maps` is map.json.

    None for a map.json of before it was known.
    """
    known = {name: found for name, found in maps.items() if "laplace" in found}
    if not known:
        return None
    named = {name: found.get("x", X_NAMES) for name, found in known.items()}
    columns = list(dict.fromkeys(n.removesuffix(" [MPa]") for own in named.values() for n in own))
    rows = []
    for name, found in known.items():
        laplace = found["laplace"] or {"sd_ratio": [None] * len(named[name])}
        names = [column.removesuffix(" [MPa]") for column in named[name]]
        ratio = dict(zip(names, laplace["sd_ratio"], strict=True))
        values = (number(ratio.get(column), 3) for column in columns)
        rows.append((name, *values, number(laplace.get("correlation_off"), 2)))
    return Table(
        "Laplace approximation: SD by the curvature at the emulator's maximum over that of samples",
        (
            "hypothesis",
            *(f"{column} [-]" for column in columns),
            "largest difference of correlations [-]",
        ),
        tuple(rows),
        "1 and 0 for a normal posterior inside its prior. A dash: the density does not fall in all "
        "directions from the maximum, as on a bound of the prior.",
    )


def rounds_table(
    maps: Mapping[str, Any], rounds: Sequence[Mapping[str, Any]], n_train: Mapping[str, int]
) -> Table | None:
    """Round by round how far the maxima lay apart; None where the first one verified all.

    `n_train` are the runs that trained the emulators in the end.
    """
    if not rounds:
        return None
    rows = []
    for name, found in maps.items():
        for index, each in enumerate(rounds):
            then = each[name]
            rows.append(
                _round(name, index, then["n_train"], then, then["verified"], len(then["added"]))
            )
        last = {"difference_sd": largest_difference(found), "n_fe_solves": found["n_fe_solves"]}
        rows.append(_round(name, len(rounds), n_train[name], last, is_verified(found), 0))
    return Table(
        "Verification: runs added at the maximum by direct FE, and the posterior sampled anew",
        (
            "hypothesis",
            "round",
            "trained on [runs]",
            "maxima apart [SD]",
            "FE solves",
            "verified",
            "added [runs]",
        ),
        tuple(rows),
        f"Verified: within {CONFIRMED_SD} posterior SD in every unknown. The runs added are those "
        "that the search by direct FE took, with their sensitivities.",
    )


def _round(
    name: str, index: int, n_train: int, found: Mapping[str, Any], verified: bool, n_added: int
) -> tuple[str, ...]:
    return (
        name,
        str(index),
        str(n_train),
        number(found["difference_sd"], 3),
        str(found["n_fe_solves"]),
        "yes" if verified else "NO",
        str(n_added) if n_added else "-",
    )
