"""How rough force and field of the FE model are along a short line of its parameters.

    python -m benchmarks.emulator_roughness [--contact stick slide] [--store FOLDER]

Nine runs along s, 0.005 apart, at r = 0.5. What a parabola leaves of them is a roughness that no
emulator of a few dozen runs can follow: it is the least error to expect of one on single runs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.emulator_runs import CELLS, TRAVEL, family, simulate
from fe.campaign_result import Campaign
from fe.response import Array

R, S = 0.5, 0.3 + 0.005 * np.arange(9)


def main(arguments: list[str] | None = None) -> None:
    """Run the lines and print their roughness."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.emulator_roughness", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--contact", nargs="+", default=["stick", "slide"])
    parser.add_argument("--store", type=Path, default=Path("runs/emulator_roughness"))
    options = parser.parse_args(arguments)
    points = np.column_stack([np.full(len(S), R), S])
    print("| contact | what |", " | ".join(f"{travel:g} mm" for travel in TRAVEL), "|")
    for contact in options.contact:
        model = family(("r", "s"), contact, CELLS[contact])
        campaign = simulate(points, model, options.store, lambda done, total: None)
        for what, values in roughness(campaign).items():
            print(f"| {contact} | {what} |", " | ".join(f"{v:.2g}" for v in values), "|")


def roughness(campaign: Campaign) -> dict[str, Array]:
    """(n_step,) root mean squares of what parabolas in s leave, and what gradients miss."""
    field = campaign.displacement.reshape(len(S), len(TRAVEL), -1)
    slope = campaign.displacement_gradient[..., 1].reshape(field.shape)
    step = np.diff(S)[:, None, None]
    missed = np.diff(field, axis=0) - 0.5 * (slope[1:] + slope[:-1]) * step
    return {
        "field, mm": _left(field),
        "force, %": 100.0 * _left(np.log(campaign.force)[:, :, None]),
        "jump of the field between neighbours, mm": np.sqrt(np.mean(missed**2, axis=(0, 2))),
        "largest such jump of a point, mm": np.abs(missed).max(axis=(0, 2)),
    }


def _left(values: Array) -> Array:
    """(n_step,) of values (n, n_step, n_obs), n - 3 degrees of freedom."""
    basis = np.linalg.qr(np.vander(S - S.mean(), 3))[0]
    flat = values.reshape(len(S), -1)
    rest = (flat - basis @ (basis.T @ flat)).reshape(values.shape)
    left: Array = np.sqrt(np.sum(rest**2, axis=0).mean(axis=1) / (len(S) - 3))
    return left


if __name__ == "__main__":
    main()
