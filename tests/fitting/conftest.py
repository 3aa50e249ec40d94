"""The variant that all fits here run in."""

import pytest

from tests.fitting import studio


@pytest.fixture(autouse=True)
def variant() -> None:
    studio.use()
