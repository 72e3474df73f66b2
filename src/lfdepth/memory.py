"""How much memory this process may still take."""

from __future__ import annotations

from pathlib import Path

_CGROUP = Path("/sys/fs/cgroup")


def available_memory() -> int | None:
    """Bytes that can be taken without swapping, of the machine or of a container; None: unknown."""
    import psutil

    limits = [int(psutil.virtual_memory().available)]
    container = _container_memory(_CGROUP)
    return min([*limits, container]) if container is not None else limits[0]


def _container_memory(folder: Path) -> int | None:
    """Bytes left to a container (control groups, version 2); None where there is no limit."""
    try:
        limit = (folder / "memory.max").read_text(encoding="ascii").strip()
        used = int((folder / "memory.current").read_text(encoding="ascii"))
        cached = dict(
            line.split() for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines()
        )
    except (OSError, ValueError):
        return None
    if limit == "max":
        return None
    # Pages of files that nobody uses now can be had.
    return max(int(limit) - used + int(cached.get("inactive_file", 0)), 0)


def size_text(size: float) -> str:
    """A number of bytes in words."""
    return f"{size / 1e9:.2g} GB" if size >= 1e9 else f"{size / 1e6:.0f} MB"
