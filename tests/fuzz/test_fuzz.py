"""Damaged files of every kind are read or refused in one clean line; more of them by benchmarks/fuzz.py."""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import psutil
import pytest

import fuzz_run
from fuzz_mutations import damage
from fuzz_run import Outcome, run
from fuzz_seeds import KINDS

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="children are forked")
INPUTS = 120
"""Three of every kind; the slow test takes 500 more."""


def outcomes(numbers: list[int], seed: int) -> list[Outcome]:
    with ProcessPoolExecutor(1) as pool:  # in a process of its own, which has no threads
        return pool.submit(_run, numbers, seed).result()


def _run(numbers: list[int], seed: int) -> list[Outcome]:
    return list(run(numbers, seed=seed))


@pytest.mark.parametrize(
    "numbers", [range(INPUTS), pytest.param(range(INPUTS, INPUTS + 500), marks=pytest.mark.slow)]
)
def test_damaged_files_are_read_or_refused_cleanly(numbers: range) -> None:
    found = outcomes(list(numbers), seed=20)
    assert [each.number for each in found] == list(numbers)
    assert [str(each) for each in found if each.bad] == []
    assert {each.what for each in found} == {"read", "refused"}


@pytest.mark.parametrize(("number", "seed"), [(453, 77)])
def test_inputs_that_were_bad(number: int, seed: int) -> None:
    """A TIFF that says of more pages than it has that they are its own."""
    (found,) = outcomes([number], seed)
    assert not found.bad, str(found)


def test_whole_files_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz_run, "damage", lambda files, chance: files)
    found = list(run(range(len(KINDS))))
    assert {each.seed for each in found} == set(KINDS)
    assert [str(each) for each in found if each.what != "read"] == []


def shout(*words: Any) -> int:
    os.write(1, b"library says hello\n")
    return 0


def crash(*words: Any) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def raise_error(*words: Any) -> int:
    raise RuntimeError("of a library")


def say_two_lines(*words: Any) -> int:
    print("error: one\nerror: two", file=sys.stderr)
    return 2


def leave_a_file(*words: Any) -> int:
    Path("left").write_text("x")
    print("{}")
    return 0


def fill_memory(*words: Any) -> int:
    kept = bytearray(b"x" * int(fuzz_run.MEMORY * 1.2))
    print("{}" if kept else "")
    return 0


def dawdle(*words: Any) -> int:
    time.sleep(fuzz_run.SECONDS * fuzz_run.WAITING * 1.1)
    print("{}")
    return 0


def hang(*words: Any) -> int:
    while True:
        pass


def change_input(words: list[str]) -> int:
    Path(words[1]).write_bytes(b"x")
    print("{}")
    return 0


@pytest.mark.thin(2)
@pytest.mark.parametrize(
    ("act", "what"),
    [
        (shout, "spoilt output"),
        (crash, "ended"),
        (raise_error, "traceback"),
        (say_two_lines, "unclean error"),
        (leave_a_file, "wrote"),
        (fill_memory, "memory"),
        (dawdle, "slow"),
        (hang, "slow"),
        (change_input, "changed what it was given"),
    ],
)
def test_what_is_bad_is_seen(monkeypatch: pytest.MonkeyPatch, act: Any, what: str) -> None:
    monkeypatch.setattr(fuzz_run, "_warm_up", lambda scratch: None)
    monkeypatch.setattr(fuzz_run, "SECONDS", 0.3 if what == "slow" else fuzz_run.SECONDS)
    here = psutil.Process().memory_info().rss  # which a fork begins with
    monkeypatch.setattr(fuzz_run, "MEMORY", here + 3e8)
    monkeypatch.setattr("lfdepth.cli.main", act)
    (found,) = run([0], only="npy")
    assert (found.bad, found.what) == (True, what), found


def test_damage_is_the_same_for_the_same_number() -> None:
    files = {"a.npy": bytes(range(256)) * 10, "b.json": b'{"a": 1}'}
    for number in range(50):
        first, second = (damage(files, random.Random(f"0 {number}")) for _ in range(2))
        assert first == second
    assert sum(damage(files, random.Random(f"0 {number}")) != files for number in range(50)) > 40
