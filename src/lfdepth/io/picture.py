"""Pictures as arrays: PNG through imagecodecs, TIFF through tifffile, EXR, PGM, PPM; others through Pillow.

Pillow would reduce 16-bit colour PNG and PPM to 8 bits, and does not read 16-bit colour TIFF.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import exr, limits, pnm, signature
from lfdepth.io.alpha import without_alpha
from lfdepth.io.extras import need_tifffile
from lfdepth.io.pixels import encode_png
from lfdepth.io.png_text import with_text
from lfdepth.io.white import white_of_bits, whole_samples

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm", ".pnm", ".exr")
"""File names that are taken for pictures."""

_PILLOW_FORMATS = ("JPEG", "BMP", "WEBP")
# Compressions of TIFF whose decoders stop where the page ends: none, LZW, deflate, PackBits, LZMA, Zstandard.
_TIFF_PACKING = (1, 5, 8, 32946, 32773, 34925, 34926, 50000)
# The colour type in a PNG header.
_PNG_MODES = {0: "L", 2: "RGB", 3: "P", 4: "LA", 6: "RGBA"}
_GREY_OR_RGB = ("L", "RGB", "I;16")
_WITH_ALPHA = ("LA", "RGBA")
# Tags of a TIFF that state the largest sample: MaxSampleValue, SMaxSampleValue, and WhiteLevel of DNG.
_TIFF_WHITE = (281, 341, 50717)
# Fewer bits than the type has, that tifffile unpacks.
_PACKED_BITS = (10, 12, 14)


def read_picture(path: Path, *, drop_alpha: bool = False) -> npt.NDArray[Any]:
    """Decode a grey or RGB picture.

    Parameters
    ----------
    path : Path
        PNG, TIFF, OpenEXR, PGM, PPM, or what Pillow reads.
    drop_alpha : bool
        Read the colours also where alpha is not opaque, instead of refusing it.

    Returns
    -------
    ndarray, shape (H, W, C)
        uint8 or uint16, from TIFF and OpenEXR also float32; C = 1 or 3.

    Raises
    ------
    LightFieldError
        If the file is missing, truncated, no picture, partly transparent, or neither grey nor RGB.
    """
    try:
        pixels, mode = _decode(path)
    except FileNotFoundError:
        raise LightFieldError(f"{path}: no such file; expected a picture; check the path") from None
    except PermissionError:
        raise LightFieldError(f"{path}: not readable; expected a picture; check the permissions") from None
    except LightFieldError:
        raise
    except Exception as error:  # decoders raise many kinds, from OSError to their own
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise LightFieldError(
            f"{path}: not a readable picture ({reason}); expected a complete image file; copy or convert "
            "it again"
        ) from error
    if mode in _WITH_ALPHA:
        return pixels[..., :-1] if drop_alpha else without_alpha(pixels, str(path))
    if mode not in _GREY_OR_RGB:
        raise LightFieldError(f"{path}: picture of mode {mode}; expected grey or RGB, no palette; convert it")
    return pixels if pixels.ndim == 3 else pixels[..., None]


def stated_white(path: Path) -> float | None:
    """The value of white that a picture's header states, if it does: PGM, PPM and TIFF.

    Raises
    ------
    LightFieldError
        If the header is damaged.
    """
    try:
        with path.open("rb") as file:
            header = file.read(4)
        if header.startswith(pnm.SIGNATURES):
            return pnm.read_white(path)
        if header.startswith(signature.TIFF):
            with need_tifffile(path).TiffFile(path) as file:
                return white_of_page(file.pages[0])
    except LightFieldError:
        raise
    except Exception:  # the picture will be refused when it is read, with the reason
        return None
    return None


def white_of_page(page: Any) -> float | None:
    """The value of white that a page of a TIFF states, if it does."""
    page = page.keyframe
    if page.dtype is None or page.dtype.kind != "u":
        return None
    if page.bitspersample in _PACKED_BITS:
        return white_of_bits(page.bitspersample)
    for tag in _TIFF_WHITE:
        if tag in page.tags:
            level = float(np.max(page.tags[tag].value))
            if 0 < level <= white_of_bits(8 * page.dtype.itemsize):
                return level
    return None


def write_picture(path: Path, pixels: npt.NDArray[Any], *, text: str | None = None) -> None:
    """Encode a grey or RGB picture (H, W, C) by the path's ending, exactly.

    Parameters
    ----------
    path : Path
        Ends in `.png` or `.tif`.
    pixels : ndarray
        uint8 or uint16; for TIFF also float32.
    text : str, optional
        What a PNG says of itself; see `png_text`.
    """
    squeezed = np.ascontiguousarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels)
    if path.suffix.lower() == ".png":
        png = encode_png(squeezed)
        path.write_bytes(png if text is None else with_text(png, text))
    else:
        photometric = "minisblack" if squeezed.ndim == 2 else "rgb"
        need_tifffile(path).imwrite(path, squeezed, photometric=photometric, metadata=None)


def write_mask(path: Path, mask: npt.NDArray[np.bool_]) -> None:
    """Encode a mask (H, W) as a picture, white where it is True."""
    write_picture(path, mask[..., None].astype(np.uint8) * np.uint8(255))


def checked_name(name: str, folder: Path) -> str:
    """A name that comes from a file, if it can be that of a file in a folder."""
    if not re.fullmatch(r"\w[\w .+-]*", name):
        raise LightFieldError(
            f"{folder}: mask {name!r}; expected a name of letters, digits, spaces and _ . + -; rename it"
        )
    return name


def _decode(path: Path) -> tuple[npt.NDArray[Any], str]:
    with path.open("rb") as file:
        header = file.read(26)
    if header.startswith(signature.PNG):
        return _decode_png(path, header)
    if header.startswith(signature.TIFF):
        return _decode_tiff(path)
    if header.startswith(signature.EXR):
        return exr.read_colours(path)
    if header.startswith(pnm.SIGNATURES):
        pixels = pnm.read_pnm(path)
        return pixels, "L" if pixels.ndim == 2 else "RGB"
    return _decode_with_pillow(path)


def _decode_png(path: Path, header: bytes) -> tuple[npt.NDArray[Any], str]:
    import imagecodecs

    mode = _PNG_MODES.get(header[25], "unknown")
    if mode not in ("L", "RGB", *_WITH_ALPHA):
        return np.empty((1, 1)), mode
    width, height = (int.from_bytes(header[at : at + 4], "big") for at in (16, 20))
    limits.check_unpacked(path, (height, width, len(mode)), max(1, header[24] // 8))
    pixels = np.asarray(imagecodecs.png_decode(path.read_bytes()))
    # A single colour that counts as transparent (tRNS) becomes alpha on decoding.
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    return pixels, {1: "L", 2: "LA", 3: "RGB", 4: "RGBA"}[channels]


def _decode_tiff(path: Path) -> tuple[npt.NDArray[Any], str]:
    with need_tifffile(path).TiffFile(path) as file:
        return decode_page(file.pages[0], str(path))


def check_page(page: Any) -> None:
    """Raise LightFieldError if a page of a TIFF asks for more memory than it may, or is packed otherwise.

    Formats within the format, such as JPEG, have sizes of their own, which may be others than the page says.
    """
    if getattr(page, "parent", None) is None:  # in memory already
        return
    path = Path(page.parent.filehandle.path)
    limits.check_unpacked(path, page.shape, 1 if page.dtype is None else page.dtype.itemsize)
    packing = page.keyframe.compression
    if packing not in _TIFF_PACKING:
        raise LightFieldError(
            f"{path}: page compressed as {getattr(packing, 'name', packing)}; expected none, LZW, deflate, "
            "PackBits, LZMA or Zstandard; store it as one of these"
        )


def decode_page(page: Any, what: str) -> tuple[npt.NDArray[Any], str]:
    """A page of a TIFF, called `what` in messages, in native byte order, and its mode elsewhere."""
    first = page.keyframe  # pages like the first have no tags of their own
    check_page(page)
    pixels = np.asarray(page.asarray())
    kind, bits = first.photometric.name, first.bitspersample
    whole_bits = bits == 8 * pixels.dtype.itemsize or bits in _PACKED_BITS
    if kind in ("PALETTE", "MINISWHITE") or not whole_bits:
        return pixels, f"{kind} with {str(bits)[:40]} bits"
    if pixels.dtype.kind == "f":
        pixels = pixels.astype(np.float32)
    elif pixels.dtype.kind not in "ui":
        return pixels, str(pixels.dtype)
    else:
        pixels = whole_samples(pixels, what)
    if pixels.ndim == 3 and first.planarconfig == 2:  # a plane for each channel
        pixels = np.moveaxis(pixels, 0, -1)
    if pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 1):
        return pixels, "L"
    channels = pixels.shape[2] if pixels.ndim == 3 else 0
    known = {("MINISBLACK", 2): "LA", ("RGB", 4): "RGBA"}
    return pixels, "RGB" if channels == 3 else known.get((kind, channels), f"with shape {pixels.shape}")


def _decode_with_pillow(path: Path) -> tuple[npt.NDArray[Any], str]:
    from PIL import Image, ImageOps

    # Of all that Pillow knows: it would hand PostScript, for example, to an interpreter.
    with Image.open(path, formats=_PILLOW_FORMATS) as picture:
        limits.check_unpacked(path, (picture.height, picture.width, len(picture.getbands())), 1)
        upright = ImageOps.exif_transpose(picture)  # cameras store portraits lying down
        return np.asarray(upright), upright.mode
