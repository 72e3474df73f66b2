from pathlib import Path

import pytest
from hypothesis import settings

DATA = Path(__file__).resolve().parents[2] / "shared/data"

# How long an example takes says nothing on a machine that is busy, or where it compiles kernels.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Real light fields, which lie beside the repository and are not part of it."""
    if not DATA.is_dir():
        pytest.skip(f"real data is absent: {DATA}")
    return DATA
