"""First bytes of files, by which formats are recognised."""

from __future__ import annotations

from pathlib import Path

EXR = b"\x76\x2f\x31\x01"
HDF5 = b"\x89HDF\r\n\x1a\n"
LYTRO = b"\x89LFP\r\n\x1a\n"
MATLAB_5 = b"MATLAB 5.0 MAT-file"
MATLAB_7_3 = b"MATLAB 7.3 MAT-file"
NPY = b"\x93NUMPY"
PNG = b"\x89PNG\r\n\x1a\n"
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
ZIP = b"PK\x03\x04"


def starts_with(path: Path, *signatures: bytes) -> bool:
    """True for a file that begins with one of the signatures."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(max(map(len, signatures))).startswith(signatures)
