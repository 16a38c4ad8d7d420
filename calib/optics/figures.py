"""Field of view and depth of field over the distance to the sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from calib.optics.search import Found
from calib.plot_scales import plain_log


def distance_figure(found: Sequence[Found]) -> Figure:
    """One line a lens, at the focal length, aperture and angle of its best set-up.

    Thin: within reach; thick: all limits are met; dot: the best. Depth of field is divided by the
    depth needed at the same angle, so that one line marks enough for all lenses.
    """
    figure = Figure(figsize=(7.0, 6.4), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    colours = style.library["tableau-colorblind10"]["axes.prop_cycle"].by_key()["color"]
    for index, one in enumerate(found):
        line, colour = one.distances, colours[index % len(colours)]
        setup, seen = one.setup, one.seen
        label = f"{one.lens}, f/{setup.f_stop:g}, {setup.half_angle:g}°"
        ratio = line.depth_of_field / line.depth_needed
        best = float(seen.depth_of_field) / float(seen.depth_needed)
        panels = ((top, line.field_width, float(seen.field_width)), (bottom, ratio, best))
        for axis, values, at_best in panels:
            axis.plot(line.object_distance, values, color=colour, linewidth=0.8)
            usable = np.where(line.is_feasible, values, np.nan)
            axis.plot(line.object_distance, usable, color=colour, linewidth=3.5, label=label)
            fill = colour if one.is_feasible else "none"
            axis.plot(float(setup.object_distance), at_best, "o", mec=colour, mfc=fill)
    bottom.axhline(1.0, color="#777777", linestyle=":")
    top.set(yscale="log", ylabel="width of the field of view [mm]")
    bottom.set(xscale="log", yscale="log", xlabel="distance from lens to sample [mm]")
    bottom.set_ylabel("depth of field / depth needed [-]")
    bottom.set_ylim(top=30)
    for axis in (top.yaxis, bottom.xaxis, bottom.yaxis):
        plain_log(axis)
    top.set_title(
        "thick: all limits met; filled dot: best; open dot: closest to usable", fontsize=9
    )
    bottom.set_title("dotted: depth of field just enough", fontsize=9)
    handles, _ = top.get_legend_handles_labels()
    figure.legend(handles=handles, fontsize=8, frameon=False, loc="outside lower center", ncols=3)
    for axis in (top, bottom):
        axis.spines[["top", "right"]].set_visible(False)
    return figure
