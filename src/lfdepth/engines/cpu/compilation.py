"""How kernels are compiled, where they are kept, and when: it takes seconds once, and is to be told apart."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any

KERNEL: dict[str, Any] = {"nogil": True, "cache": True, "no_cfunc_wrapper": True}
"""Options of functions that Python calls."""

INNER: dict[str, Any] = {**KERNEL, "no_cpython_wrapper": True}
"""Of functions that only kernels call: without a wrapper for Python they compile faster."""

_ENGINE = Path(__file__).parent
_SHARED = _ENGINE.parent / "layout.py", _ENGINE.parent / "scene_layout.py"
"""Files elsewhere that kernels take constants from."""

_NAME = "lfdepth"
_KEPT_DAYS = 7
"""Days after which kernels of an earlier state are deleted; a process may still be at work with others."""


@contextmanager
def kernel_cache() -> Iterator[None]:
    """Kernels that are declared while the context is open are kept in a folder of the engine's present state.

    numba looks at the file of a function only, not at what it calls or takes constants from, so that a change
    there would be missed. The folder's name holds a digest of all files that kernels are made of. Where no
    folder can be written numba is left to say so.
    """
    from numba import config
    from numba.core import caching

    given, usual = config.CACHE_DIR, caching.IndexDataCacheFile
    folder = _writable(given)
    if folder is not None:
        config.CACHE_DIR = str(folder)
    caching.IndexDataCacheFile = one_file_each(usual)
    try:
        yield
    finally:
        config.CACHE_DIR, caching.IndexDataCacheFile = given, usual


def one_file_each(usual: Any) -> Any:
    """Numba's class of cache files, changed so that no two kernels are ever given one file.

    numba numbers the files of a function's compiled forms by its index. Two processes that compile it for
    different types at the same time take the same number; then the index leads from one's types to the
    other's code, which reads arrays of other types or layouts, and computes nonsense without a word.
    Here the name of a file is told by the types, and the index is read again right before it is written.
    """

    class OneFileEach(usual):  # type: ignore[misc]  # numba has no types
        def save(self, key: Any, data: Any) -> None:
            """Save a compiled form, then its entry: an entry that another process loses is compiled again."""
            name = self._data_name_pattern.replace(
                "{number:d}", blake2b(repr(key).encode(), digest_size=8).hexdigest()
            )
            self._save_data(name, data)
            self._save_index({**self._load_index(), key: name})

    return OneFileEach


def sources() -> list[Path]:
    """The files that kernels are made of."""
    return [*sorted(_ENGINE.rglob("*.py")), *_SHARED]


def digest() -> str:
    """Digest of the files that kernels are made of."""
    found = blake2b(digest_size=8)
    for path in sources():
        content = path.read_bytes()
        found.update(f"{path.name} {len(content)}\n".encode())
        found.update(content)
    return found.hexdigest()


def _writable(given: str) -> Path | None:
    """The folder for this state, where the user says, or else beside the kernels or among the user's caches.

    None where it cannot be written.
    """
    installed = blake2b(str(_ENGINE).encode(), digest_size=4).hexdigest()
    places = [Path(given)] if given else [_ENGINE / "kernels" / "__pycache__", _user_caches() / _NAME]
    for place in places:
        folder = place / f"{_NAME}-{installed}-{digest()}"
        with suppress(OSError):
            if not folder.is_dir():
                _delete_old(place, f"{_NAME}-{installed}-*")
                folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    return None


def _user_caches() -> Path:
    if os.name == "nt":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _delete_old(place: Path, pattern: str) -> None:
    """Delete folders of earlier states of this installation."""
    for folder in place.glob(pattern):
        if folder.stat().st_mtime < time.time() - _KEPT_DAYS * 86400:
            shutil.rmtree(folder, ignore_errors=True)


def on_compilation(act: Callable[[], None]) -> AbstractContextManager[Any]:
    """While the context is open, act whenever numba compiles because its cache has nothing."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]  # numba has no types
        def on_start(self, event: Any) -> None:
            act()

        def on_end(self, event: Any) -> None:
            pass

    context: AbstractContextManager[Any] = event.install_listener("numba:compile", Listener())
    return context
