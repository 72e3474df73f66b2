"""Kernels made ready while views are read are just those that the estimate then needs."""

from __future__ import annotations

import subprocess
import sys

import pytest

from lfdepth import methods
from lfdepth.cli.ahead import rehearse
from lfdepth.engines.cpu.ahead import Rehearsal

PROGRAM = """
import sys
from threading import Event
import numpy as np
import lfdepth
from lfdepth.cli.ahead import rehearse
from lfdepth.engines.cpu.ahead import Rehearsal, make_ready
from lfdepth.engines.cpu.compilation import on_compilation

name, samples = sys.argv[1:]
method = lfdepth.method(name)
compiled = []
with on_compilation(lambda: compiled.append(1)), Rehearsal() as engine:
    rehearse(method, engine, samples)
    make_ready(engine.calls, Event())
    before = len(compiled)
    noise = np.random.default_rng(1).random((9, 9, 40, 48, 3))
    white = 255 if samples == "uint8" else 1
    views = lfdepth.LightField((noise * white).astype(samples))
    lfdepth.estimate(views, method, range=(-1, 1), threads=2)
print(len(engine.calls), len(compiled) - before)
"""
"""Prints how many kernels were made ready, and how many were compiled after that."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "samples"), [("fbs-vis", "uint8"), ("fbsocc-sfa", "float32")])
def test_nothing_is_compiled_after_what_was_made_ready(name: str, samples: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, name, samples], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    ready, late = map(int, done.stdout.split())
    assert ready >= 3
    assert late == 0


@pytest.mark.parametrize("name", methods.FAMILY)
def test_a_rehearsal_runs_no_kernel_and_names_each_once(name: str) -> None:
    with Rehearsal() as engine:
        rehearse(methods.method(name), engine, "uint16")
    called = [kernel.py_func.__name__ for kernel, _ in engine.calls]
    assert "vote_kernel" in called
    # Every kernel on one set of types: none is compiled twice.
    assert len(called) == len(set(called))
    assert ("photo_kernel" in called) == (name == "fbs-vis")


def test_windows_too_large_for_a_rehearsal_are_left_alone() -> None:
    with Rehearsal() as engine:
        rehearse(methods.method("fbs-sfa", radius=500), engine, "uint8")
    assert engine.calls == []
