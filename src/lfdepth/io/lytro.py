"""Raw Lytro pictures: recognised, so that the error can say what turns them into something readable."""

from __future__ import annotations

from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.io import signature
from lfdepth.io.layout import Layout
from lfdepth.io.source import ViewSource


def recognise(path: Path) -> bool:
    """True for Lytro's container, or a file named `.lfp`, `.lfr` or `.lfx`."""
    return signature.starts_with(path, signature.LYTRO) or (
        path.is_file() and path.suffix.lower() in (".lfp", ".lfr", ".lfx")
    )


def open_lytro(path: Path, layout: Layout) -> ViewSource:
    """Refuse a raw Lytro picture: decoding it needs the camera's own calibration.

    Raises
    ------
    LightFieldError
        Always; names decoders and what they write.
    """
    del layout
    raise LightFieldError(
        f"{path}: raw Lytro picture; expected decoded views; decode it with the camera's calibration data "
        "and read "
        "what comes out: PlenoptiCam (pip install plenopticam, a folder of views) or MATLAB's Light Field "
        "Toolbox "
        "(LFUtilDecodeLytroFolder, a .mat file; LFWriteESLF, an ESLF picture)"
    )
