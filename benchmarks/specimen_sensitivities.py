"""Sensitivities of the specimens without a pin: cost of all of them, direct against adjoint.

    python -m benchmarks.specimen_sensitivities

Processor time of a solve with the derivatives in every parameter over that with none, one thread,
the least of three runs after one that compiles, and the largest difference of the two gradients of
a weighted sum of field and force, relative to the parameter's largest.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from fe import (
    Contact,
    Cylinder,
    CylinderModel,
    Disc,
    DiscPinModel,
    NotchedPlate,
    Response,
    TensileModel,
)
from fe.materials import material

RUBBER = material("mooney-rivlin-3", (0.3, 0.2, 0.05), 200.0)
Model = TensileModel | CylinderModel | DiscPinModel
MODELS: dict[str, Model] = {
    "notched plate, 6 x 12 x 2, to 15 mm": TensileModel(
        NotchedPlate(), (6, 12, 2), (3.0, 7.5, 15.0)
    ),
    "cylinder, bonded, 8 x 6, to 9 mm": CylinderModel(
        Cylinder(), (8, 6), (1.5, 3.0, 6.0, 9.0), "bonded"
    ),
    "cylinder, friction 0.2, 8 x 6, to 9 mm": CylinderModel(
        Cylinder(), (8, 6), (1.5, 3.0, 6.0, 9.0), friction=0.2
    ),
    "disc under a pin, stuck, 12 x 6, to 1.4 mm": DiscPinModel(
        Disc(), Contact("stick", "stick"), (12, 6), (0.6, 0.8, 1.0, 1.2, 1.4)
    ),
    "disc under a pin, friction 0.3 / 0.2, 12 x 6, to 1.4 mm": DiscPinModel(
        Disc(), Contact(0.3, 0.2), (12, 6), (0.6, 0.8, 1.0, 1.2, 1.4)
    ),
}


def timed(model: Model) -> tuple[Response, float]:
    """The response and the processor time of the model's solve, s."""
    found = []
    for _ in range(4):
        started = time.process_time()
        response = model.respond(RUBBER)
        found.append(time.process_time() - started)
    return response, min(found[1:])


def direct_adjoint_difference(model: Model, base: Response) -> float:
    """Largest difference of the two, relative."""
    rng = np.random.default_rng(0)
    weights = rng.standard_normal(base.displacement.shape)
    by_force = rng.standard_normal(base.force.size)
    adjoint = model.objective_gradients(RUBBER, lambda i, field, force: (weights[i], by_force[i]))
    direct = by_force[:, None] * base.force_gradient
    direct = direct + np.einsum("ipk,ipkj->ij", weights, base.displacement_gradient)
    scale = np.abs(direct).max(axis=0)
    moves = scale > 0.0  # nothing depends on the contact of a side that touches nothing
    return float((np.abs(adjoint - direct).max(axis=0)[moves] / scale[moves]).max())


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("| specimen | parameters | s with none | cost of all % | direct against adjoint |")
    print("|---|---|---|---|---|")
    for name, model in MODELS.items():
        _, alone = timed(replace(model, sensitivities=()))
        every = replace(model, sensitivities=model.parameter_names(RUBBER))
        response, together = timed(every)
        cost = 100.0 * (together / alone - 1.0)
        difference = direct_adjoint_difference(every, response)
        n_p = len(response.parameters)
        print(f"| {name} | {n_p} | {alone:.2f} | {cost:.0f} | {difference:.0e} |", flush=True)


if __name__ == "__main__":
    main()
