"""What a batch has to do: which scene becomes which file, with which settings, and what is there already."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.methods import Method
from lfdepth.methods import method as named_method
from lfdepth.version import __version__

ENDING = ".npz"
PROVENANCE = "batch"
"""Name of the array in a result that says what it was made of."""
THUMBNAILS = "thumbnails"
_DIGITS = 8


@dataclass(frozen=True)
class Job:
    """One scene of a batch. Plain words and numbers: it travels to workers, and pixels do not.

    Attributes
    ----------
    scene
        Path of the light field, or an address that fsspec knows (`s3://…`), as the workers see it.
    folder
        Folder of the results, as the workers see it.
    method
        Name of the method.
    options
        All its parameters.
    reading
        How the scene is read, as `lfdepth.read` takes it.
    settings
        Range, engine and equalisation, as `lfdepth.estimate` takes them.
    threads
        Threads of one estimate; it has no part in the result.
    """

    scene: str
    folder: str
    method: str
    options: Mapping[str, Any] = field(default_factory=dict)
    reading: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    threads: int | None = 1

    @property
    def name(self) -> str:
        """A name that follows from the scene's path: its last part, and a digest of the whole."""
        digest = hashlib.sha256(self.scene.encode()).hexdigest()[:_DIGITS]
        last = self.scene.rstrip("/").rpartition("/")[2].partition(".")[0]
        return f"{last or 'scene'}-{digest}"

    @property
    def target(self) -> Path:
        """The file of the result."""
        return Path(self.folder) / f"{self.name}{ENDING}"

    @property
    def thumbnail(self) -> Path:
        """A small picture of the result."""
        return Path(self.folder) / THUMBNAILS / f"{self.name}.webp"

    @property
    def key(self) -> str:
        """What a scheduler knows the job by: equal jobs of several clients are done once."""
        digest = hashlib.sha256(json.dumps(asdict(self), sort_keys=True, default=str).encode())
        return f"lfdepth-{self.name}-{digest.hexdigest()[:16]}"

    def chosen(self) -> Method:
        """The method with its parameters."""
        return named_method(self.method, **self.options)

    def provenance(self) -> dict[str, Any]:
        """What a result of this job says that it was made of."""
        return {
            "scene": self.scene,
            "lfdepth": __version__,
            "method": {"name": self.method, **self.options},
            "reading": {key: _plain(value) for key, value in self.reading.items()},
            "settings": {key: _plain(value) for key, value in self.settings.items()},
        }

    def is_done(self) -> bool:
        """Whether the result is there; LightFieldError where it was made of something else."""
        found = told_by(self.target, (PROVENANCE,), "a result of a batch")
        if found is None:
            return False
        check_made_of(self.target, found[0], self.provenance())
        return True

    def stamp(self) -> NDArray[Any]:
        """`provenance` as an array, for the file of the result."""
        return np.asarray(json.dumps(self.provenance(), sort_keys=True, default=str))


def jobs_for(
    scenes: Sequence[str | Path],
    folder: Path,
    method: Method,
    *,
    reading: Mapping[str, Any],
    settings: Mapping[str, Any],
    threads: int | None,
) -> list[Job]:
    """A job for each scene.

    Raises
    ------
    LightFieldError
        If there are no scenes, or one is named twice.
    """
    if not scenes:
        raise LightFieldError("batch: no scenes; expected at least one; name them")
    common: dict[str, Any] = {
        "folder": str(folder.resolve()),
        "method": method.name,
        "options": {key: value for key, value in method.parameters().items() if value is not None},
        "reading": {key: value for key, value in reading.items() if value is not None},
        "settings": dict(settings),
        "threads": threads,
    }
    jobs = [Job(scene=_address(scene), **common) for scene in scenes]
    seen: set[str] = set()
    for job in jobs:
        if job.scene in seen:
            raise LightFieldError(f"batch: {job.scene} is named twice; expected each scene once; drop one")
        seen.add(job.scene)
    return jobs


def is_remote(scene: str) -> bool:
    """Whether a scene is an address for fsspec and not a path."""
    return "://" in scene


@contextmanager
def at_hand(scene: str) -> Iterator[Path]:
    """The path of a scene; what has an address is fetched for the time of the context."""
    if not is_remote(scene):
        yield Path(scene)
        return
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise LightFieldError(
            f"{scene}: needs the package fsspec, which is not installed; expected the extra 'cluster'; "
            'run: pip install "lfdepth[cluster]"'
        ) from None
    with TemporaryDirectory(prefix="lfdepth-") as folder:
        local = Path(folder) / scene.rstrip("/").rpartition("/")[2]
        try:
            system, inner = url_to_fs(scene)
            system.get(inner, str(local), recursive=True)
        except Exception as error:  # each kind of file system raises its own
            raise LightFieldError(
                f"{scene}: cannot be fetched ({' '.join(str(error).split())[:200]}); expected a readable "
                "address; check it"
            ) from None
        yield local


def _address(scene: str | Path) -> str:
    return str(scene) if is_remote(str(scene)) else str(Path(scene).resolve())


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


def told_by(path: Path, names: Sequence[str], what: str) -> list[Any] | None:
    """The JSON that a result holds under these names; None where it is not there.

    Raises
    ------
    LightFieldError
        If the file is none of ours.
    """
    try:
        with np.load(path) as found:
            return [json.loads(str(found[name])) for name in names]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise LightFieldError(
            f"{path}: exists but is not {what} ({' '.join(str(error).split())[:100]}); expected one, or "
            "nothing; move it, or choose another folder"
        ) from None


def check_made_of(path: Path, found: Any, wanted: Any) -> None:
    """Raise LightFieldError where a result says that it was made of something else than is wanted now."""
    plain = json.loads(json.dumps(wanted, default=str))
    if found != plain:
        raise LightFieldError(
            f"{path}: exists, made with other settings ({_difference(found, plain)}); expected the same; "
            "choose another folder, or remove it"
        )


def _difference(found: Any, wanted: Any, where: str = "") -> str:
    """The first thing in which two nested dictionaries differ."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in sorted({*found, *wanted}):
            if found.get(key) != wanted.get(key):
                return _difference(found.get(key), wanted.get(key), key)
    return f"{where} {found} instead of {wanted}"
