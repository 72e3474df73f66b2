"""Every public function and class shows an example, and every example gives what it says."""

from __future__ import annotations

import doctest
import inspect
import tempfile
from pathlib import Path
from typing import Any

import pytest

import lfdepth
from lfdepth import scenes

PUBLIC = {f"lfdepth.{name}": getattr(lfdepth, name) for name in lfdepth.__all__} | {
    f"lfdepth.scenes.{name}": getattr(scenes, name)
    for name in scenes.__all__
    if callable(getattr(scenes, name))
}


@pytest.fixture(autouse=True)
def _temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the examples write goes where pytest cleans up."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.mark.parametrize("name", PUBLIC)
def test_the_example_of(name: str) -> None:
    told: list[str] = []
    found = examples(PUBLIC[name], name)
    assert found.examples, f"{name} has no example"
    assert "Examples\n--------" in inspect.cleandoc(PUBLIC[name].__doc__)
    failed = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(found, out=told.append).failed
    assert not failed, "".join(told)


def test_a_wrong_example_fails() -> None:
    """The check itself can fail."""

    def wrong() -> None:
        """
        >>> 1 + 1
        3
        """

    found = examples(wrong, "wrong")
    assert doctest.DocTestRunner(verbose=False).run(found, out=lambda _: None).failed == 1


def examples(thing: Any, name: str) -> doctest.DocTest:
    """The examples in a docstring, without those of members."""
    return doctest.DocTestParser().get_doctest(inspect.getdoc(thing) or "", {}, name, None, None)
