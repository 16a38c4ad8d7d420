"""Tables of the calibration of real cylinders, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def print_row(one: Mapping[str, Any]) -> None:
    """One line while the work goes on."""
    mean, sd = one["kappa_kPa"]
    print(
        f"{one['law']}, {one['ends']}: kappa {mean:.2f} +- {sd:.2f} kPa, "
        f"ln evidence {one['log_evidence']:.2f}",
        flush=True,
    )


def print_tables(facts: Mapping[str, Any]) -> None:
    """Posterior, left-out repeats, published fits, tension."""
    _posteriors(facts["models"])
    _left_out(facts["models"])
    _published(facts)
    _tension(facts["models"])


def _posteriors(models: list[dict[str, Any]]) -> None:
    print(
        "\n| law | plates | kappa kPa | constants kPa | friction | P(C01 < 0) | misfit % |", end=""
    )
    print(" discrepancy % | zero mm | stiffness % | own % | ln evidence |\n|" + "---|" * 12)
    for one in models:
        constants = ", ".join(f"{m:.2f} +- {s:.2f}" for m, s in one["constants_kPa"])
        friction = one.get("friction_median_94")
        rubbed = "-" if friction is None else "{:.2f} ({:.2f}-{:.2f})".format(*friction)
        negative = one.get("probability_C01_negative")
        print(
            f"| {one['law']} | {one['ends']} | {one['kappa_kPa'][0]:.2f} +- "
            f"{one['kappa_kPa'][1]:.2f} | {constants} | {rubbed} | "
            f"{'-' if negative is None else f'{negative:.2f}'} | {100 * one['rms_misfit']:.1f} | "
            f"{100 * one['discrepancy_sd']:.1f} | {one['zero_sd_mm']:.3f} | "
            f"{100 * one['stiffness_sd']:.2f} | {100 * one['own_sd']:.2f} | "
            f"{one['log_evidence']:.2f} +- {one['log_evidence_sd']:.2f} |"
        )


def _left_out(models: list[dict[str, Any]]) -> None:
    print("\n| law | plates | ln density of 5 left out | RMS error % | within 94 % | largest z |")
    print("|" + "---|" * 6)
    for one in models:
        print(
            f"| {one['law']} | {one['ends']} | {one['left_out_log_density']:.1f} | "
            f"{100 * one['left_out_rms_error']:.2f} | {100 * one['left_out_within_94']:.0f} % | "
            f"{one['left_out_largest_z']:.1f} |"
        )


def _published(facts: Mapping[str, Any]) -> None:
    heads = " | ".join(f"{t:g} mm %" for t in facts["travel"])
    print(
        f"\n| published fit | kappa kPa | RMS % | {heads} |\n|"
        + "---|" * (3 + len(facts["travel"]))
    )
    for one in facts["published"]:
        errors = " | ".join(f"{100 * e:+.1f}" for e in one["relative_error"])
        print(
            f"| {one['law']} | {one['kappa_kPa']:.2f} | {100 * one['rms_error']:.1f} | {errors} |"
        )


def _tension(models: list[dict[str, Any]]) -> None:
    first = models[0]["tension"]
    heads = " | ".join(f"{s:g}" for s in first["stretch"])
    print(f"\n| law | plates | {heads} |\n|" + "---|" * (2 + len(first["stretch"])))
    measured = " | ".join(f"{m:.2f} kPa" for m in first["measured_kPa"])
    print(f"| measured elsewhere | | {measured} |")
    for one in models:
        found = one["tension"]
        cells = " | ".join(
            f"{m:.1f} ({low:.1f}-{high:.1f}), x{r:.2f}"
            for m, low, high, r in zip(
                found["predicted_kPa"],
                found["low_kPa"],
                found["high_kPa"],
                found["ratio"],
                strict=True,
            )
        )
        print(f"| {one['law']} | {one['ends']} | {cells} |")
