"""Image files: grey TIFF, PNG or BMP of 8 to 16 bit."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import imageio.v3
import numpy as np
from skimage import io

from calib.dic.interpolation import Array

LUMINANCE = np.array([0.2125, 0.7154, 0.0721])
"""of red, green and blue (ITU-R BT.709), as scikit-image has it"""

NOT_LEVELS = {"P": "a palette", "PA": "a palette", "CMYK": "four printing inks (CMYK)"}
"""of TIFF files by the mode that Pillow gives them"""

TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
STARTS = (*TIFF_STARTS, b"\x89PNG", b"BM")
"""of files that keep grey levels as they are: TIFF, PNG, BMP"""
JPEG_START = b"\xff\xd8\xff"
LOSSY = {"jpeg": "a JPEG", "tiff_jpeg": "a JPEG", "webp": "a WebP"}
"""what a TIFF file may hold, by the compression that Pillow names"""
ZERO_IS_WHITE = 0
"""photometric interpretation of a TIFF file, as of ImageJ's inverting tables"""


@dataclass(frozen=True)
class GreyImage:
    """One image."""

    name: str
    grey: Array
    """(h, w) grey levels as in the file"""
    full_scale: float
    """largest grey level that the sensor can give: 255 for 8 bit; of 16 bit files, the next power
    of two less one above the brightest pixel (10, 12, 14 or 16 bit cameras)"""


def read_image(path: Path | str) -> GreyImage:
    """Read one image; colours become luminance.

    Raises ValueError when the file is missing, no image, one with losses, several, of a palette or
    of printing inks, transparent, or not of 8 to 16 bit.
    """
    path = Path(path)
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise ValueError(f"{path}: found {found}, expected an image (TIFF, PNG or BMP)")
    with path.open("rb") as stream:
        start = stream.read(8)
    if start.startswith(JPEG_START):
        raise _with_losses(path, "a JPEG")
    values, by_pillow = _values(path, start)
    if start.startswith(TIFF_STARTS):
        values = _levels_of_tiff(path, values, by_pillow)
    if values.dtype == np.bool_ or values.dtype.kind not in "u" or values.dtype.itemsize > 2:
        raise ValueError(f"{path}: expected 8 to 16 bit grey levels, found {values.dtype}")
    is_byte = values.dtype.itemsize == 1
    opaque = np.iinfo(values.dtype).max
    if values.ndim == 3 and values.shape[2] == 4 and np.any(values[..., 3] < opaque):
        raise ValueError(f"{path}: expected an opaque image, found pixels that are transparent")
    if values.ndim == 3 and values.shape[2] in (3, 4):
        grey = values[..., :3] @ LUMINANCE
        if np.all(values[..., :3] == values[..., :1]):
            grey = values[..., 0].astype(np.float64)
    elif values.ndim == 2:
        grey = values.astype(np.float64)
    else:
        raise ValueError(f"{path}: expected one grey or colour image, found shape {values.shape}")
    return GreyImage(path.name, np.ascontiguousarray(grey), _full_scale(values, is_byte))


def _with_losses(path: Path, found: str) -> ValueError:
    """Of a kind of picture that keeps blocks of 8 px, not grey levels."""
    return ValueError(
        f"{path}: expected an image without losses (TIFF, PNG or BMP), found {found}, which "
        "has blocks of 8 px that are not in the scene"
    )


def _levels_of_tiff(path: Path, values: np.ndarray, by_pillow: bool) -> np.ndarray:
    """The values of a TIFF file, turned over where its tag says that 0 is white.

    Pillow, where it has read them, does so itself for 8 bit.

    Refuses files whose numbers are not the grey levels or colours of one picture.
    """
    try:
        with _quietly(), imageio.v3.imopen(path, "r", plugin="pillow") as file:
            every = cast("int", ...)  # as imageio documents and its types do not say
            n_page = file.properties(index=every).n_images or 1
            sizes = [file.properties(index=page).shape[:2] for page in range(n_page)]
            facts = file.metadata(index=0, exclude_applied=False)
    except Exception:  # what Pillow does not read has been read otherwise
        return values
    mode = facts["mode"]
    if lossy := LOSSY.get(str(facts.get("compression", ""))):
        raise _with_losses(path, f"a TIFF that holds {lossy}")
    alike = sizes.count(sizes[0])  # a thumbnail beside the image is none
    if alike > 1:
        raise ValueError(f"{path}: expected a file of one image, found {alike} pages of one size")
    if mode == "P" and np.array_equal(
        imageio.v3.imread(path, index=0, plugin="pillow", mode="L"), values
    ):
        return values  # a palette of greys in their order
    if mode in NOT_LEVELS:
        raise ValueError(f"{path}: expected grey levels or RGB colours, found {NOT_LEVELS[mode]}")
    is_white = facts.get("PhotometricInterpretation") == ZERO_IS_WHITE
    if not is_white or (by_pillow and mode == "L") or values.dtype.kind != "u":
        return values
    turned: np.ndarray = np.iinfo(values.dtype).max - values
    return turned


@contextmanager
def _quietly() -> Iterator[None]:
    """Without what decoders say of a damaged file beside what they raise."""
    said = logging.getLogger("tifffile")
    before = said.disabled
    said.disabled = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        said.disabled = before


def _values(path: Path, start: bytes) -> tuple[np.ndarray, bool]:
    """What a file holds, and whether Pillow has read it.

    Decoders raise anything at a damaged file: all of it is a refusal.
    """
    refusal = ValueError(
        # what decoders say names their inner parts, which tells the user nothing
        f"{path}: expected a whole TIFF, PNG or BMP file, found "
        + (f"one that starts with {start!r}" if start else "an empty one")
        + " that cannot be read"
    )
    if not start.startswith(STARTS):
        raise refusal
    by_pillow = False
    with _quietly():
        try:
            values = np.asarray(io.imread(path))
        except Exception:
            # some compressions need a package that scikit-image lacks, but Pillow reads them
            try:
                values, by_pillow = np.asarray(imageio.v3.imread(path, plugin="pillow")), True
            except Exception as error:
                raise refusal from error
    if not values.size:  # of a file whose pages are beyond its end
        raise refusal
    return values, by_pillow


def _full_scale(values: np.ndarray, is_byte: bool) -> float:
    if is_byte:
        return 255.0
    brightest = int(values.max(initial=0))
    return float(next((2**bit - 1 for bit in (10, 12, 14) if brightest < 2**bit), 65535))


def read_series(paths: Sequence[Path]) -> tuple[GreyImage, ...]:
    """Read images of one camera.

    Raises ValueError as read_image, or when one has another size than the first.
    """
    if not paths:
        raise ValueError("images: expected one or more files, found none")
    images = tuple(read_image(path) for path in paths)
    check_sizes(images)
    return images


def check_sizes(images: Sequence[GreyImage]) -> None:
    """Raises ValueError when an image has another size than the first."""
    first = images[0]
    for image in images[1:]:
        if image.grey.shape != first.grey.shape:
            found = f"{image.grey.shape[1]} x {image.grey.shape[0]}"
            expected = f"{first.grey.shape[1]} x {first.grey.shape[0]} px as in {first.name}"
            raise ValueError(f"{image.name}: expected {expected}, found {found}")
