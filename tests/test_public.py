"""The names that `import lfdepth` offers."""

import inspect
import subprocess
import sys

import pytest

import lfdepth


@pytest.mark.parametrize("name", lfdepth.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    assert inspect.getdoc(getattr(lfdepth, name))
    assert name in dir(lfdepth)


def test_names_that_are_none() -> None:
    with pytest.raises(AttributeError, match="no attribute 'estimat'"):
        _ = lfdepth.estimat


def test_a_name_is_not_taken_by_a_module_of_the_same_name() -> None:
    """Importing a submodule sets an attribute of its package, whichever comes first."""
    code = (
        "import lfdepth, pkgutil, importlib\n"
        "modules = {module.name for module in pkgutil.iter_modules(lfdepth.__path__)}\n"
        "assert not modules & set(lfdepth.__all__), modules & set(lfdepth.__all__)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_importing_loads_nothing_heavy() -> None:
    code = (
        "import sys, lfdepth\n"
        "heavy = {'numpy', 'numba', 'scipy', 'matplotlib', 'PIL', 'imagecodecs', 'h5py'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
