"""The ideal mirror."""

from __future__ import annotations

import numpy as np
import pytest

from brdf import Lobe, defaults, evaluate
from brdf.models.mirror import Mirror
from tests.brdf.arrays import VECTORS, to_numpy
from tests.oracles import directions


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_mirror(kind: str) -> None:
    """The mirror image, exactly; the tint, channel by channel; no light elsewhere."""
    vector = VECTORS[kind]
    wi = vector(*directions.hemisphere(100, 1).T)
    p = defaults(Mirror(), vector, specular_reflectance=(0.25, 0.5, 1.0))
    wo, weight, eta = Mirror().ideal(p, wi, 0)
    np.testing.assert_array_equal(to_numpy(wo), to_numpy(wi) * [[-1], [-1], [1]])
    np.testing.assert_array_equal(to_numpy(weight).ravel(), [0.25, 0.5, 1.0])
    assert eta == 1
    assert Mirror.lobes == (Lobe.MIRROR,)
    assert (to_numpy(evaluate(Mirror(), p, wi, wo)) == 0).all()
