"""Damaged files through the command line: how many of them are neither read nor refused in one clean line.

    python benchmarks/fuzz.py --inputs 20000 --seed 1
    python benchmarks/fuzz.py --only map-exr --inputs 500
    python benchmarks/fuzz.py --number 1234 --seed 1 --keep bad      # one of them again

Every input runs in a process of its own, with at most 10 s of computing and 1.5 GB. Seeds, damage and what
counts as bad are in tests/fuzz; three of every kind run with the tests.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/fuzz"))

from fuzz_run import Outcome, run, summary
from reporting import Cell, machine_line, markdown, write_json

_BATCH = 250


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="one kind of file")
    parser.add_argument("--number", type=int, help="only this input")
    parser.add_argument("--keep", type=Path, help="folder for the inputs that were bad")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    began = time.perf_counter()
    wanted = range(options.inputs) if options.number is None else [options.number]
    batches = [wanted[start : start + _BATCH] for start in range(0, len(wanted), _BATCH)]
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(options.processes) as pool:
        jobs = [
            pool.submit(_batch, list(batch), options.seed, options.only, options.keep) for batch in batches
        ]
        for job in jobs:
            outcomes += job.result()
            for outcome in outcomes[-_BATCH:]:
                if outcome.bad:
                    print(f"bad: {outcome}", flush=True)
            print(f"{len(outcomes)} inputs", file=sys.stderr, flush=True)
    table = summary(outcomes)
    columns = ("read", "refused", "bad")
    rows: list[list[Cell]] = [
        [name, *(counts.get(each, 0) for each in columns)] for name, counts in table.items()
    ]
    rows.append(["all", *(sum(counts.get(each, 0) for counts in table.values()) for each in columns)])
    print(markdown(("file", *columns), rows))
    bad = sum(outcome.bad for outcome in outcomes)
    print(f"\n{bad} of {len(outcomes)} inputs bad, seed {options.seed}, {time.perf_counter() - began:.0f} s")
    print(machine_line())
    write_json(options.json, {"inputs": len(outcomes), "bad": bad, "table": table})
    return bool(bad)


def _batch(numbers: list[int], seed: int, only: str | None, keep: Path | None) -> list[Outcome]:
    return list(run(numbers, seed, only, keep))


if __name__ == "__main__":
    os.nice(5)
    sys.exit(main())
