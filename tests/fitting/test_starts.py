"""The search for a start: where a function on a grid has its valleys."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.starts import VALLEYS, valleys


def test_two_valleys() -> None:
    """The deeper first, each where its parabola has its lowest point, between the points of the grid."""
    x = np.linspace(-3, 3, 61)
    y = np.minimum((x + 1.234) ** 2 + 0.1, 2 * (x - 1.777) ** 2)
    np.testing.assert_allclose(valleys(x, y), [1.777, -1.234], atol=1e-9)


def test_an_end_is_a_valley_if_there_is_no_other() -> None:
    x = np.linspace(0, 1, 11)
    assert valleys(x, x) == pytest.approx([0.0])


def test_not_more_than_are_looked_into() -> None:
    x = np.linspace(0, 40, 401)
    assert len(valleys(x, np.cos(x))) == VALLEYS
