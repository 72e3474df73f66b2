from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared/data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Real light fields, which lie beside the repository and are not part of it."""
    if not DATA.is_dir():
        pytest.skip(f"real data is absent: {DATA}")
    return DATA
