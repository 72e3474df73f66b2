"""What is lost or half-written when commands are killed, run out of disk, or write to the same place.

    python benchmarks/survival.py --rounds 50 --seed 1
    python benchmarks/survival.py --only "convert folder" bench
    mount -t tmpfs -o size=64m tmpfs /mnt && python benchmarks/survival.py --disk /mnt   # fill a disk

Each command is killed at `--rounds` random times and before as many of its file operations, run with half as
many limits on the size of files, and two at once. What is checked is in tests/survival; a few rounds run with
the tests.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/survival"))

from reporting import Cell, machine_line, markdown, write_json
from survival_run import (
    COMMANDS,
    Command,
    Report,
    Trial,
    changing_input,
    disk_sizes,
    prepare,
    random_fates,
    read_only,
)

_COLUMNS = ("runs", "killed", "finished", "refused", "old", "new", "neither")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=list(COMMANDS))
    parser.add_argument(
        "--disk", type=Path, help="folder on a disk of less than 1 GB: fill it instead of killing"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    began = time.perf_counter()
    reports: dict[str, Report] = {}
    with tempfile.TemporaryDirectory(prefix="lfdepth-survival-") as scratch:
        folder = Path(scratch)
        data = prepare(folder)
        for name in options.only or COMMANDS:
            random = Random(options.seed)
            if options.disk is None:
                reports[name] = _survive(Trial(COMMANDS[name], data, folder), options.rounds, random)
            else:
                reports[name] = _fill(COMMANDS[name], data, options.disk, options.rounds, random)
            _print_problems(reports[name])
            print(f"{name}: {reports[name].runs} runs", file=sys.stderr, flush=True)
        if not options.only and options.disk is None:
            reports["input that changes"] = changing = Report()
            changing_input(data, folder, options.rounds, changing)
            reports["read-only folders"] = locked = Report()
            read_only(data, folder, locked)
            _print_problems(changing)
            _print_problems(locked)
    rows: list[list[Cell]] = [
        [name, report.runs, *(report.outcomes[each] for each in _COLUMNS[1:]), len(report.problems)]
        for name, report in reports.items()
    ]
    print(markdown(("command", *_COLUMNS, "problems"), rows))
    runs = sum(report.runs for report in reports.values())
    problems = sum(len(report.problems) for report in reports.values())
    print(f"\n{problems} problems in {runs} runs, seed {options.seed}, {time.perf_counter() - began:.0f} s")
    print(machine_line())
    write_json(options.json, {"runs": runs, "problems": problems})
    return bool(problems)


def _survive(trial: Trial, rounds: int, random: Random) -> Report:
    report = Report()
    for what, fate in random_fates(trial, rounds, rounds, random):
        trial.kill(fate, report, what)
    for size in disk_sizes(trial, max(2, rounds // 2), random):
        trial.fill_disk(size, report)
    for _ in range(max(1, rounds // 5)):
        trial.race(report)
    return report


def _fill(command: Command, data: Path, disk: Path, rounds: int, random: Random) -> Report:
    report = Report()
    with tempfile.TemporaryDirectory(dir=disk) as scratch:
        trial = Trial(command, data, Path(scratch))
        for left in disk_sizes(trial, rounds, random):
            trial.fill_small_disk(left, report)
    return report


def _print_problems(report: Report) -> None:
    for problem in report.problems:
        print(f"problem: {problem}", flush=True)


if __name__ == "__main__":
    os.nice(5)
    sys.exit(main())
