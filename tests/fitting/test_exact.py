"""Points drawn from a reconstruction filter against sums over its own values."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from fitting.picture.exact import filter_points, guided_points

FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")
#: Pixels drawn, and the film's borders about each [pixels from its centre]: in the middle, at the left, in a corner.
N = 20_000
SPANS = {
    "middle": ((-9.5, 9.5), (-9.5, 9.5)),
    "left": ((-0.5, 9.5), (-9.5, 9.5)),
    "corner": ((-1.5, 9.5), (-9.5, 0.5)),
}


def picture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Something lopsided with a highlight of a pixel's size."""
    return np.exp(-((x - 0.6) ** 2 + (y - 0.3) ** 2)) + 0.3 * x + 0.1 * x * y


@pytest.mark.parametrize("where", SPANS)
@pytest.mark.parametrize("samples", [2, 16])
@pytest.mark.parametrize("name", FILTERS)
def test_points_make_up_the_filtered_picture(name: str, samples: int, where: str) -> None:
    rfilter = mi.load_dict({"type": name})
    radius = rfilter.radius()
    at = (np.arange(2000) + 0.5) / 1000 * radius - radius
    value = np.array(rfilter.eval(mi.Float(at.astype(np.float32))), dtype=np.float64)
    along = [np.where((at > low) & (at < high), value, 0) for low, high in SPANS[where]]
    product = np.outer(*along)
    expected = (product * picture(at[:, None], at[None, :])).sum() / product.sum()

    spans = tuple((np.full(N, low), np.full(N, high)) for low, high in SPANS[where])
    (x, y), share = filter_points(rfilter, spans, samples, 2, np.random.default_rng(5))
    for offset, (low, high) in zip((x, y), SPANS[where], strict=True):
        assert max(low, -radius) <= offset.min() and offset.max() <= min(high, radius)
    share, each = share.reshape(N, samples), (share * picture(x, y)).reshape(N, samples).sum(axis=1)
    np.testing.assert_allclose(share.sum(axis=1), 1, rtol=1e-12)
    assert abs(each.mean() - expected) < 4 * each.std() / N**0.5 + 1e-5
    assert each.std() < {2: 1.5, 16: 0.25}[samples]


@pytest.mark.parametrize("kind", ["gaussian", "lanczos", "mitchell", "tent", "box"])
def test_samples_placed_where_it_is_bright_have_the_same_mean(kind: str) -> None:
    """Of a smooth picture with a peak, at a corner, an edge and inside; the peak with far less noise."""
    rfilter, side, cells, n = mi.load_dict({"type": kind}), 8, 4, 1 << 16
    column, row = np.array([0, 3, 7]), np.array([2, 0, 4])
    spans = [(-at - 0.5, side - at - 0.5) for at in (column, row)]
    reach = int(cells * rfilter.radius())
    parts = (np.arange(-reach, reach) + 0.5) / cells

    def light(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 1 + 0.3 * np.sin(2 * x) + 0.1 * y + 300 * np.exp(-((x - 0.31) ** 2 + (y - 0.37) ** 2) / 0.02)

    guide = np.tile(light(parts[None, :], parts[:, None]), (3, 1, 1))
    means = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        for points, share in (
            filter_points(rfilter, spans, n, 2, rng),
            guided_points(rfilter, spans, n, 2, rng, guide, cells),
        ):
            means.append((share * light(points[0], points[1])).reshape(3, -1).sum(axis=1))
    np.testing.assert_allclose(means[1], means[0], rtol=0.02)
    np.testing.assert_allclose(means[3], means[1], rtol=5e-3)
