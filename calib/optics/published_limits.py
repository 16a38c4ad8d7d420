"""What the thesis' chosen set-up (lens set 2) would be by the thin lens and diffraction."""

from __future__ import annotations

from collections.abc import Iterator

from calib.data.thesis import thesis_table
from calib.optics.design_file import Camera
from calib.optics.published import COLUMNS, OBJECT_DISTANCE, ROWS
from calib.optics.thin_lens import (
    airy_diameter,
    effective_f_stop,
    far_field_of_view,
    field_of_view,
    magnification,
)

# not printed; gives the diagonal of 11.016 mm behind Table 3.3
CAMERA = Camera(columns=COLUMNS, rows=ROWS, pixel=0.00345)
WAVELENGTH = 0.00055  # mm, green


def published_limits() -> Iterator[str]:
    """One sentence for each effect that Eqs. A.1 to A.14 leave out and that changes the result."""
    table = thesis_table("Appendix A.2")
    cell = dict(zip(table.cells("symbol"), table.cells("value"), strict=True))
    sensor, focal, f_stop = (float(cell[name]) for name in ("d", "FL", "F_stop"))
    scale = magnification(focal, OBJECT_DISTANCE)
    yield (
        f"Eq. A.5 is for objects far away: at {OBJECT_DISTANCE:g} mm from the lens it gives "
        f"a field of {far_field_of_view(sensor, OBJECT_DISTANCE, focal):.1f} mm, "
        f"the thin lens {field_of_view(sensor, scale):.1f} mm"
    )
    yield (
        f"the lens covers {sensor:g} mm, the sensor of {COLUMNS} x {ROWS} pixels has a diagonal of "
        f"{CAMERA.diagonal:.2f} mm: the frame of Eqs. A.11 and A.12 is "
        f"{CAMERA.diagonal / sensor:.2f} times too small, or its corners are dark"
    )
    airy = airy_diameter(effective_f_stop(f_stop, scale), WAVELENGTH) / CAMERA.pixel
    yield (
        f"at f/{f_stop:g} diffraction spreads a point over {float(airy):.1f} pixels, "
        f"more than a subset of 6 x 5 pixels"
    )
