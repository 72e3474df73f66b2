"""Damaged files through the command line, each in a child process with bounds on time and memory.

Bad is whatever is neither a result nor one clean line of error: a traceback, a process that ends by itself or
takes too long or too much memory, words on standard output that are not the result, files that were written
or changed. What is heavy is loaded once; children are forked from there, so an input takes milliseconds.
"""

from __future__ import annotations

import gc
import importlib
import io
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

from fuzz_mutations import damage
from fuzz_seeds import COMMANDS, Seed, make_seeds

SECONDS = 10.0
"""An input that is computed on for longer is bad: on a busy machine, too, this is what reading takes."""
WAITING = 6.0
"""So is one that takes that many times as long on the clock, computed on or not."""
MEMORY = 1.5e9
"""Bytes; an input whose process has more of them in memory is bad."""

_LIBRARIES = (
    "lfdepth.cli.commands", "lfdepth.cli.experiments", "lfdepth.io", "lfdepth.scoring",
    "lfdepth.bench.submission", "lfdepth.io.zarr_store", "h5py", "zarr", "scipy.io", "tifffile",
    "imagecodecs", "PIL.Image", "numpy",
    "PIL.JpegImagePlugin", "PIL.BmpImagePlugin", "PIL.WebPImagePlugin", "cyclopts", "lfdepth.estimation",
)  # fmt: skip
# Lines on standard error that may stand beside a result; and what libraries of C print there.
_REMARKS = ("failed: ", "mask left out: ")
_CHATTER = ("PNG warning: ",)
_ADDRESS_SPACE = 4 << 30  # beyond what is loaded already: memory that is asked for, and not only touched


@dataclass(frozen=True)
class Outcome:
    """What became of an input: "read", "refused", or what was bad."""

    number: int
    seed: str
    what: str
    detail: str = ""

    @property
    def bad(self) -> bool:
        """Whether it was neither read nor refused cleanly."""
        return self.what not in ("read", "refused")


def run(
    numbers: Sequence[int], seed: int = 0, only: str | None = None, keep: Path | None = None
) -> Iterator[Outcome]:
    """Run the inputs of these numbers; input `n` of a seed is always the same.

    Parameters
    ----------
    numbers
        Which inputs.
    seed
        Where chance starts.
    only
        Name of a kind of file; all kinds in turn by default.
    keep
        Folder for the inputs that were bad.
    """
    for library in _LIBRARIES:
        importlib.import_module(library)
    with tempfile.TemporaryDirectory(prefix="lfdepth-fuzz-") as scratch:
        seeds = [each for each in make_seeds(Path(scratch) / "seeds") if only in (None, each.name)]
        _warm_up(Path(scratch))
        gc.collect()
        gc.freeze()  # what is loaded stays shared with the children
        for number in numbers:
            chosen = seeds[number % len(seeds)]
            files = damage(chosen.files, Random(f"{seed} {number}"))
            place = Path(scratch) / "input"
            outcome = _outcome(number, chosen, files, place)
            if outcome.bad and keep is not None:
                shutil.copytree(place, keep / f"{number}-{chosen.name}", dirs_exist_ok=True)
            shutil.rmtree(place)
            yield outcome


def _warm_up(scratch: Path) -> None:
    """Load what commands load when they run, by one that starts no threads that stay."""
    from lfdepth.cli import main

    array = scratch / "warm.npy"
    np.save(array, np.zeros((3, 3, 8, 8, 3), np.uint8))
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        for command in COMMANDS.values():
            main(command.format(path=array, out=scratch / "warm").split())


def summary(outcomes: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """How many inputs of each kind were read, refused or bad."""
    table: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        table.setdefault(outcome.seed, Counter())["bad" if outcome.bad else outcome.what] += 1
    return {name: dict(counts) for name, counts in sorted(table.items())}


def _outcome(number: int, seed: Seed, files: dict[str, bytes], place: Path) -> Outcome:
    given, out = place / "given", place / "out"
    given.mkdir(parents=True)
    out.mkdir()
    for name, data in files.items():
        (given / name).parent.mkdir(parents=True, exist_ok=True)
        (given / name).write_bytes(data)
    before = _state(given)
    words = COMMANDS[seed.kind].format(path=given / seed.entry, out=out / "x").split()
    status, seconds, computing, peak = _in_child(words, place)
    printed, errors = ((place / name).read_bytes().decode(errors="replace") for name in ("stdout", "stderr"))
    what, detail = _judge(status, printed, errors, seed.kind)
    if computing > SECONDS or seconds > WAITING * SECONDS:
        what, detail = "slow", f"{seconds:.1f} s, {computing:.1f} s of computing"
    elif peak > MEMORY:
        what, detail = "memory", f"{peak / 1e9:.2f} GB"
    elif _state(given) != before:
        what, detail = "changed what it was given", ""
    elif unexpected := _left(out, status):
        what, detail = "wrote", unexpected
    return Outcome(number, seed.name, what, detail)


def _judge(status: int, printed: str, errors: str, kind: str) -> tuple[str, str]:
    if os.WIFSIGNALED(status):
        return "ended", signal.Signals(os.WTERMSIG(status)).name
    code = os.waitstatus_to_exitcode(status)
    lines = [line for line in errors.splitlines() if not line.startswith(_CHATTER)]
    if code == 99 or "Traceback" in errors:
        return "traceback", errors.strip()[-1500:]
    if code == 2:
        if printed or len(lines) != 1 or not lines[0].startswith("error: ") or len(lines[0]) > 2000:
            return "unclean error", f"stdout {printed[:200]!r}, stderr {errors[:600]!r}"
        return "refused", lines[0]
    try:
        json.loads(printed)
    except ValueError:
        return "spoilt output", f"{printed[:300]!r} {errors[:300]!r}"
    stray = [line for line in lines if not line.startswith(_REMARKS)]
    if code not in (0, 1) or stray:
        return "unclean result", f"status {code}, stderr {errors[:300]!r}"
    return ("refused" if kind == "submission" and code == 1 else "read"), ""


def _in_child(words: Sequence[str], place: Path) -> tuple[int, float, float, float]:
    """Run a command in a fork: wait status, seconds, those of computing, peak memory in bytes."""
    began = time.perf_counter()
    child = os.fork()
    if not child:
        _be_child(words, place)
    _, status, usage = os.wait4(child, 0)
    computing = usage.ru_utime + usage.ru_stime
    return (
        status,
        time.perf_counter() - began,
        computing,
        usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024),
    )


def _be_child(words: Sequence[str], place: Path) -> None:
    from lfdepth.cli import main

    code = 99
    try:
        # The system's own end, in whatever the process hangs.
        signal.setitimer(signal.ITIMER_PROF, SECONDS + 2)
        signal.setitimer(signal.ITIMER_REAL, WAITING * SECONDS + 2)
        _limit_memory()
        for number, name in ((1, "stdout"), (2, "stderr")):
            file = os.open(place / name, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o666)
            os.dup2(file, number)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        os.chdir(place / "out")
        code = main(words)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _limit_memory() -> None:
    status = Path("/proc/self/statm")
    if status.exists():
        now = int(status.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + _ADDRESS_SPACE, now + _ADDRESS_SPACE))


def _state(folder: Path) -> dict[str, tuple[int, int]]:
    return {
        str(file): (file.lstat().st_size, file.lstat().st_mtime_ns if not file.is_dir() else 0)
        for file in folder.rglob("*")
    }


def _left(out: Path, status: int) -> str:
    """What is in the output folder that should not be."""
    expected = {"x.npz"} if status == 0 else set()
    return ", ".join(sorted({entry.name for entry in out.iterdir()} - expected))
