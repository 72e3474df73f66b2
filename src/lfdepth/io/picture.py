"""Pictures (PNG, JPEG, ...) as arrays: 8-bit through Pillow, 16-bit PNG through imagecodecs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def read_picture(path: Path) -> npt.NDArray[Any]:
    """Decode a grey or RGB picture.

    Parameters
    ----------
    path : Path
        A file that Pillow reads, 8 or 16 bits per sample.

    Returns
    -------
    ndarray, shape (H, W, C)
        uint8 or uint16, C = 1 or 3.

    Raises
    ------
    LightFieldError
        If the file is missing, truncated, no picture, or neither grey nor RGB.
    """
    try:
        deep = _is_16_bit_png(path)
        pixels, mode = _decode_16_bit_png(path) if deep else _decode_with_pillow(path)
    except FileNotFoundError:
        raise LightFieldError(f"{path}: no such file; expected a picture; check the path") from None
    except PermissionError:
        raise LightFieldError(f"{path}: not readable; expected a picture; check the permissions") from None
    except LightFieldError:
        raise
    except Exception as error:  # decoders raise many kinds, from OSError to their own
        raise LightFieldError(
            f"{path}: not a readable picture ({_one_line(error)}); expected a complete image file; "
            "copy or convert it again"
        ) from error
    if mode not in ("L", "RGB", "I;16"):
        raise LightFieldError(
            f"{path}: picture of mode {mode}; expected grey or RGB without palette or alpha; convert it"
        )
    return pixels if pixels.ndim == 3 else pixels[..., None]


def _is_16_bit_png(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(25)
    return header.startswith(_PNG_SIGNATURE) and header[24:25] == b"\x10"


def _decode_16_bit_png(path: Path) -> tuple[npt.NDArray[Any], str]:
    # Pillow would reduce 16-bit colour to 8 bits.
    import imagecodecs

    pixels = np.asarray(imagecodecs.png_decode(path.read_bytes()))
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    return pixels, {1: "L", 2: "LA", 3: "RGB"}.get(channels, "RGBA")


def _decode_with_pillow(path: Path) -> tuple[npt.NDArray[Any], str]:
    from PIL import Image

    with Image.open(path) as picture:
        mode = picture.mode.split(";16")[0] + (";16" if picture.mode.startswith("I;16") else "")
        return np.asarray(picture), mode


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:100] or type(error).__name__
