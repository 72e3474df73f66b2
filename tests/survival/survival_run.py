"""Commands that are killed, run out of disk or get in each other's way, and what is on the disk afterwards.

A command is run with its old result in place, in a fork of this process that meets its fate: SIGKILL after
some time or before some file operation, a limit on the size of files, a second process. Then each thing that
it writes has to be the old result or the new one, whole; and the same command, run again, has to give the new
one.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import re
import resource
import shutil
import signal
import sys
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from lfdepth.camera import Camera
from lfdepth.io import atomic, read, read_high_resolution, read_record, write
from lfdepth.lightfield import LightField

LETTER = "a letter to somebody else, in the same folder"
_TEMPORARY = re.compile(r"\..*-[0-9a-f]{8}(\..*)?")
_LIBRARIES = (
    "lfdepth.cli.commands", "lfdepth.cli.experiments", "lfdepth.bench.run", "lfdepth.bench.report",
    "lfdepth.bench.submission", "lfdepth.scenes", "h5py", "zarr", "imagecodecs", "PIL.Image",
    "matplotlib.figure",
)  # fmt: skip


_SMALL_DISK = 1_000_000_000


# --- what is run, and how its result is looked at


@dataclass(frozen=True)
class Command:
    """A command with two results.

    Attributes
    ----------
    words
        The command; `{scene}`, `{out}` and `{option}` are filled in.
    old, new
        The options that give the old and the new result.
    look
        Content of what was written, without run times: by name, of things that are replaced as wholes.
    """

    name: str
    words: str
    old: str
    new: str
    look: Callable[[Path], dict[str, str]]

    def filled(self, option: str, place: Path, data: Path) -> list[str]:
        """The words of the command."""
        return self.words.format(data=data, out=place / "out", option=option).split(" ")


def _digest(*values: Any) -> str:
    digest = hashlib.sha256()
    for value in values:
        array = np.ascontiguousarray(value)
        digest.update(repr((array.shape, array.dtype.name)).encode())
        digest.update(array.tobytes())
    return digest.hexdigest()[:12]


def _map(name: str) -> Callable[[Path], dict[str, str]]:
    def look(out: Path) -> dict[str, str]:
        return {name: _digest(read_record(out / name).values)} if (out / name).exists() else {}

    return look


def _light_field(name: str) -> Callable[[Path], dict[str, str]]:
    def look(out: Path) -> dict[str, str]:
        if not (out / name).exists():
            return {}
        lf = read(out / name)
        return {name: _digest(lf.views, lf.disparity_range)}

    return look


def _bench(out: Path) -> dict[str, str]:
    found = {}
    for file in (out / "bench").rglob("*.npz"):
        if not _TEMPORARY.fullmatch(file.name):
            read_record(file)  # whole, or an error
    if (file := out / "bench/results.json").exists():
        scores = json.loads(file.read_text(encoding="utf-8"))
        found["results.json"] = _digest(sorted(_methods(scores)))
    if (file := out / "bench/report.html").exists():
        text = file.read_text(encoding="utf-8")
        assert text.rstrip().endswith("</html>"), "report.html is cut"
        found["report.html"] = _digest(sorted(set(re.findall(r"fbs:step=[\d.]+", text))))
    return found


def _methods(scores: Any) -> set[str]:
    return set(re.findall(r"fbs:step=[\d.]+", json.dumps(scores)))


def _submission(out: Path) -> dict[str, str]:
    found = {}
    for file in sorted((out / "submission/disp_maps").glob("*.pfm")):
        if not _TEMPORARY.fullmatch(file.name):
            found[file.name] = _digest(read_record(file).values)
    if (file := out / "submission/submission.zip").exists():
        with zipfile.ZipFile(file) as archive:
            assert archive.testzip() is None, "submission.zip is damaged"
            found["submission.zip"] = _digest(
                *(np.frombuffer(archive.read(name), np.uint8) for name in archive.namelist() if "pfm" in name)
            )
    return found


def _rendering(out: Path) -> dict[str, str]:
    if not (out / "scenes/wedges").exists():
        return {}
    lf, high = read(out / "scenes/wedges"), read_high_resolution(out / "scenes/wedges")
    assert high is not None, "the truth at high resolution is missing"
    assert not high.unusable, f"masks are damaged: {high.unusable}"
    return {"wedges": _digest(lf.views, lf.truth, high.truth)}


def _estimate(name: str) -> Command:
    words = f"estimate {{data}}/scene -o {{out}}/{name} --method fbs --range {{option}} --json"
    return Command(f"estimate {name}", words, "-1 1", "-2 1", _map(name))


def _convert(name: str) -> Command:
    words = f"convert {{data}}/scene -o {{out}}/{name} --range {{option}} --samples uint8 --json"
    return Command(f"convert {name}", words, "-1 1", "-2 1", _light_field(name))


COMMANDS = {
    command.name: command
    for command in (
        *map(_estimate, ("map.pfm", "map.png", "map.npz", "map.zarr")),
        *map(_convert, ("x.npy", "x.npz", "x.h5", "x.tif", "x.zarr", "folder")),
        Command(
            "bench",
            "bench {data}/scene --methods fbs:step={option} -o {out}/bench --json",
            "0.5",
            "0.25",
            _bench,
        ),
        Command(
            "submit",
            "submit {data}/benchmark -o {out}/submission --method fbs:step={option} --partial --json",
            "1.0",
            "0.5",
            _submission,
        ),
        Command(
            "scenes render",
            "scenes render wedges -o {out}/scenes --size 64 --views 3x3 --samples 1 --seed {option} --json",
            "0",
            "1",
            _rendering,
        ),
    )
}


# --- fates

Fate = Callable[[], None]


def no_fate() -> None:
    """Nothing happens."""


def killed_after(seconds: float) -> Fate:
    """The process is killed after a time."""

    def begin() -> None:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process at once, whatever it does
        signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-4))

    return begin


def killed_before(operation: int, counted: Path | None = None) -> Fate:
    """The process is killed before the file operation of that number; `counted` takes how many there are."""

    def begin() -> None:
        done = 0

        def step() -> None:
            nonlocal done
            done += 1
            if done == operation:
                os.kill(os.getpid(), signal.SIGKILL)
            if counted is not None:
                _note(counted, done)

        def hook(event: str, arguments: tuple[Any, ...]) -> None:
            if event == "open":
                flags = arguments[2] if isinstance(arguments[2], int) else 0
                if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) and str(arguments[0]) != str(counted):
                    step()
            elif event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir"):
                step()

        exchange = atomic._exchange

        def counted_exchange(first: Path, second: Path) -> bool:
            step()
            swapped = exchange(first, second)
            step()
            return swapped

        atomic._exchange = counted_exchange
        sys.addaudithook(hook)

    return begin


def _note(file: Path, number: int) -> None:
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.write(descriptor, str(number).encode())
    os.close(descriptor)


def little_disk(size: int) -> Fate:
    """No file may be larger: writing on fails, as on a full disk."""

    def begin() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return begin


# --- running


@dataclass
class Ended:
    """How a process ended: wait status, what it printed, seconds."""

    status: int
    out: str
    err: str
    seconds: float

    @property
    def code(self) -> int:
        """Exit status; negative for signals."""
        return os.waitstatus_to_exitcode(self.status)


@dataclass
class Report:
    """What became of the runs of a command."""

    runs: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


def prepare(folder: Path) -> Path:
    """Scenes to work on; and everything loaded that children would load, kernels included."""
    from contextlib import redirect_stdout
    from io import StringIO

    from lfdepth.cli import main

    for library in _LIBRARIES:
        importlib.import_module(library)
    random = np.random.default_rng(3)
    data = folder / "data"
    for path, size in ((data / "scene", 40), (data / "benchmark/cotton", 512)):
        path.parent.mkdir(parents=True, exist_ok=True)
        views = random.integers(0, 256, (3, 3, size, size, 3)).astype(np.uint8)
        camera = Camera(50, 36, 4, 2, size, size)
        truth = np.zeros((size, size), np.float32)
        write(path, LightField(views, camera, (-1.0, 1.0), truth, {}), format="benchmark")
    for number, command in enumerate(COMMANDS.values()):
        if command.name in ("estimate map.pfm", "bench", "scenes render"):
            place = folder / f"warm-{number}"
            (place / "out").mkdir(parents=True)
            with redirect_stdout(StringIO()):
                main(command.filled(command.new, place, data))
            shutil.rmtree(place)
    return data


@dataclass
class Child:
    """A process, and where what it prints comes out."""

    process: int
    out: int
    err: int
    began: float


def start(words: Sequence[str], fate: Fate) -> Child:
    """Start a command in a fork of this process. It prints into pipes, which no limit on files holds for."""
    (out, out_end), (err, err_end) = os.pipe(), os.pipe()
    process = os.fork()
    if process:
        os.close(out_end)
        os.close(err_end)
        return Child(process, out, err, time.perf_counter())
    code = 99
    try:
        os.dup2(out_end, 1)
        os.dup2(err_end, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        from lfdepth.cli import main

        fate()
        code = main(words)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def wait(child: Child) -> Ended:
    """Wait for a command."""
    texts = []
    for pipe in (child.out, child.err):
        with os.fdopen(pipe, errors="replace") as stream:
            texts.append(stream.read())
    _, status = os.waitpid(child.process, 0)
    return Ended(status, texts[0], texts[1], time.perf_counter() - child.began)


def run(words: Sequence[str], fate: Fate) -> Ended:
    """Run a command in a fork of this process."""
    return wait(start(words, fate))


class Trial:
    """A command with its old and its new result, which are made once."""

    def __init__(self, command: Command, data: Path, folder: Path) -> None:
        self.command, self.data, self.folder = command, data, folder / command.name.replace(" ", "-")
        self.old_state = self._made("old", command.old)
        self.new_state = self._made("new", command.new)
        assert self.old_state.keys() == self.new_state.keys() != set()
        assert all(self.old_state[name] != self.new_state[name] for name in self.old_state)
        place = self._place()
        self.seconds = self._run(place, no_fate).seconds
        place = self._place()
        self._run(place, killed_before(0, place / "count"))
        self.operations = int((place / "count").read_text())
        self.size = max(file.stat().st_size for file in (self.folder / "new").rglob("*") if file.is_file())

    def _made(self, name: str, option: str) -> dict[str, str]:
        place = self.folder / name
        (place / "out").mkdir(parents=True)
        ended = run(self.command.filled(option, place, self.data), no_fate)
        assert ended.code in (0, 1), ended
        return self.command.look(place / "out")

    def _place(self) -> Path:
        """A folder with the old result in it."""
        place = self.folder / "try"
        shutil.rmtree(place, ignore_errors=True)
        (place / "out").mkdir(parents=True)
        shutil.copytree(self.folder / "old/out", place / "out", dirs_exist_ok=True, symlinks=True)
        (place / "out/letter.txt").write_text(LETTER)
        return place

    def _run(self, place: Path, fate: Fate) -> Ended:
        return run(self.command.filled(self.command.new, place, self.data), fate)

    def kill(self, fate: Fate, report: Report, what: str) -> None:
        """Run to a violent end, look, and run again."""
        place = self._place()
        ended = self._run(place, fate)
        report.runs += 1
        report.outcomes["killed" if ended.code < 0 else "finished"] += 1
        if ended.code >= 0 and ended.code not in (0, 1):
            report.problems.append(f"{self.command.name}, {what}: {ended}")
        self._check(place, report, what)
        again = self._run(place, no_fate)
        state = self._look(place, report, f"{what}, run again")
        if again.code not in (0, 1) or state != self.new_state:
            report.problems.append(f"{self.command.name}, {what}: run again: {again}")

    def fill_disk(self, size: int, report: Report) -> None:
        """Run without space for larger files: one line, status 2, and nothing half-written or lost."""
        self._starve(self._place(), little_disk(size), report, f"files of at most {size} bytes")

    def fill_small_disk(self, left: int, report: Report) -> None:
        """Run with so many bytes left on the disk, a small one, that the folder of the trial is on."""
        place, filler = self._place(), self.folder / "filler"
        _fill(filler, left)
        try:
            self._starve(place, no_fate, report, f"{left} bytes left on the disk")
        finally:
            filler.unlink()

    def _starve(self, place: Path, fate: Fate, report: Report, what: str) -> None:
        ended = self._run(place, fate)
        report.runs += 1
        report.outcomes["refused" if ended.code else "finished"] += 1
        lines = ended.err.splitlines()
        if ended.code == 2 and (len(lines) != 1 or not lines[0].startswith("error: ") or ended.out):
            report.problems.append(f"{self.command.name}, {what}: {ended}")
        if ended.code not in (0, 1, 2) or "Traceback" in ended.err:
            report.problems.append(f"{self.command.name}, {what}: {ended}")
        self._check(place, report, what)
        left = [path.name for path in (place / "out").rglob("*") if _TEMPORARY.fullmatch(path.name)]
        if left:
            report.problems.append(f"{self.command.name}, {what}: left {left}")

    def race(self, report: Report) -> None:
        """Two processes write the same: one wins, none corrupts."""
        place = self._place()
        children = [
            start(self.command.filled(option, place, self.data), no_fate)
            for option in (self.command.old, self.command.new)
        ]
        for child in children:
            ended = wait(child)
            if ended.code not in (0, 1):
                report.problems.append(f"{self.command.name}, race: {ended}")
        report.runs += 1
        self._check(place, report, "race")

    def _look(self, place: Path, report: Report, what: str) -> dict[str, str]:
        try:
            return self.command.look(place / "out")
        except Exception as error:
            report.problems.append(f"{self.command.name}, {what}: {type(error).__name__}: {error}")
            return {}

    def _check(self, place: Path, report: Report, what: str) -> None:
        """Every thing is there, and is the old one or the new one; nothing else was touched."""
        state = self._look(place, report, what)
        for name, old in self.old_state.items():
            found = {old: "old", self.new_state[name]: "new"}.get(state.get(name, ""), "neither")
            report.outcomes[found] += 1
            if found == "neither":
                report.problems.append(f"{self.command.name}, {what}: {name} is neither old nor new")
        if (place / "out/letter.txt").read_text() != LETTER:
            report.problems.append(f"{self.command.name}, {what}: another file was changed")
        expected = {entry.name for entry in (self.folder / "old/out").iterdir()} | {"letter.txt"}
        for entry in (place / "out").iterdir():
            if entry.name not in expected and not _TEMPORARY.fullmatch(entry.name):
                report.problems.append(f"{self.command.name}, {what}: {entry.name} was left")


def _fill(filler: Path, left: int) -> None:
    """Write a file that leaves so many bytes on its disk, which may be a small one only."""
    disk = os.statvfs(filler.parent)
    free = disk.f_bavail * disk.f_frsize
    if free > _SMALL_DISK:
        raise ValueError(f"{filler.parent} has {free / 1e6:.0f} MB left; expected a disk of less than 1 GB")
    with filler.open("wb") as file:
        file.write(bytes(max(0, free - left)))


def changing_input(data: Path, folder: Path, rounds: int, report: Report) -> None:
    """Convert a light field while another process replaces it: the old views, the new ones, or an error."""
    random = np.random.default_rng(4)
    fields = [LightField(random.integers(0, 256, (3, 3, 60, 60, 3)).astype(np.uint8)) for _ in range(2)]
    states = {_digest(lf.views) for lf in fields}
    for name in ("x.npy", "x.npz", "x.h5", "x.zarr", "x"):
        source = folder / "changing" / name
        source.parent.mkdir(parents=True, exist_ok=True)
        write(source, fields[0])
        stop = folder / "stop"
        writer = os.fork()
        if not writer:
            number = 0
            while not stop.exists():
                number += 1
                write(source, fields[number % 2])
            os._exit(0)
        for _ in range(rounds):
            target = folder / "copy.npy"
            ended = run(["convert", str(source), "-o", str(target), "--json"], no_fate)
            report.runs += 1
            lines = ended.err.splitlines()
            if ended.code == 2 and len(lines) == 1 and lines[0].startswith("error: "):
                report.outcomes["refused"] += 1
            elif ended.code == 0 and _digest(read(target).views) in states:
                report.outcomes["read"] += 1
            else:
                report.problems.append(f"changing {name}: {ended}")
        stop.touch()
        os.waitpid(writer, 0)
        stop.unlink()


def read_only(data: Path, folder: Path, report: Report) -> None:
    """Write into folders that may not be written, as a user who is not root."""
    for command in COMMANDS.values():
        place = folder / "locked"
        (place / "out").mkdir(parents=True)
        (place / "out/letter.txt").write_text(LETTER)
        (place / "out").chmod(0o555)

        def begin() -> None:
            if os.geteuid() == 0:
                os.setgid(65534)
                os.setuid(65534)

        ended = run(command.filled(command.new, place, data), begin)
        report.runs += 1
        lines = ended.err.splitlines()
        if ended.code != 2 or len(lines) != 1 or not lines[0].startswith("error: ") or ended.out:
            report.problems.append(f"{command.name}, read-only folder: {ended}")
        else:
            report.outcomes["refused"] += 1
        if [entry.name for entry in (place / "out").iterdir()] != ["letter.txt"]:
            report.problems.append(f"{command.name}, read-only folder: something was written")
        (place / "out").chmod(0o755)
        shutil.rmtree(place)


def random_fates(trial: Trial, kills: int, operations: int, random: Random) -> list[tuple[str, Fate]]:
    """Kills at random times, and before random file operations."""
    times = [random.uniform(0, trial.seconds) for _ in range(kills)]
    every = range(1, trial.operations + 1)
    steps = every if operations >= len(every) else sorted(random.sample(every, operations))
    return [(f"killed after {each:.4f} s", killed_after(each)) for each in times] + [
        (f"killed before operation {each} of {trial.operations}", killed_before(each)) for each in steps
    ]


def disk_sizes(trial: Trial, count: int, random: Random) -> list[int]:
    """Limits on the size of files, from none at all to what is needed."""
    return [0, *(random.randrange(trial.size) for _ in range(count - 1))]
