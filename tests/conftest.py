import signal
from collections import defaultdict
from pathlib import Path

import pytest
from hypothesis import settings

DATA = Path(__file__).resolve().parents[2] / "shared/data"

# How long an example takes says nothing on a machine that is busy, or where it compiles kernels.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")

# Shells make what they start in the background deaf to SIGINT, and so all that is started from there: tests
# of Ctrl-C would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Real light fields, which lie beside the repository and are not part of it."""
    if not DATA.is_dir():
        pytest.skip(f"real data is absent: {DATA}")
    return DATA


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test with many cases, marked `thin(n)`, only every nth is run by default; the others are slow.

    A stride that shares no factor with the numbers of values meets each value of every parameter.
    """
    met: defaultdict[str, int] = defaultdict(int)
    for item in items:
        mark = item.get_closest_marker("thin")
        if mark is not None:
            name = item.nodeid.partition("[")[0]
            if met[name] % mark.args[0]:
                item.add_marker("slow")
            met[name] += 1
