"""Networks in ONNX files, run by onnxruntime."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError


class OnnxNetwork:
    """A network in an ONNX file.

    Parameters
    ----------
    path
        The file.
    leading
        The first sizes that its input has to have.
    name
        Of the method, for messages.
    content
        What a file would hold, where it was made from the weights in `path`.

    Raises
    ------
    LightFieldError
        If onnxruntime is not installed, or the file is no such network.
    """

    def __init__(self, path: Path, leading: tuple[int, ...], name: str, content: bytes | None = None) -> None:
        try:
            runtime = import_module("onnxruntime")
        except ImportError:
            raise LightFieldError(
                f'{path}: needs onnxruntime, which is not installed; expected the extra "onnx"; run: '
                'pip install "lfdepth[onnx]"'
            ) from None
        self._session: Any = _session(runtime, path, content)
        taken = self._session.get_inputs()
        if len(taken) != 1 or tuple(taken[0].shape[: len(leading)]) != leading:
            raise LightFieldError(
                f"{path}: found a network that takes {[each.shape for each in taken]}, expected one "
                f"input that begins with {leading}: this is no {name}; give a file that lfdepth "
                "weights export wrote"
            )
        self._input: str = taken[0].name

    def __call__(self, stacks: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Run it."""
        found = self._session.run(None, {self._input: stacks})[0]
        return np.asarray(found, np.float32)


def _session(runtime: Any, path: Path, content: bytes | None) -> Any:
    options = runtime.SessionOptions()
    options.log_severity_level = 4
    options.enable_mem_pattern = False  # tiles differ in size
    try:
        return runtime.InferenceSession(content or str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions have no common base but this
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise LightFieldError(
            f"{path}: cannot be used ({reason}), expected a network in ONNX's format; give another file"
        ) from None
