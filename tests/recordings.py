"""Where the real recordings are, if they are: beside the checkout."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "shared" / "data"


def recording(name):
    """Return the path of a real recording; skip the test where it is absent."""
    path = FOLDER / name
    if not path.exists():
        pytest.skip(f"the real recording {name} is not beside this checkout")
    return path
