"""The pilot, on layers whose answers are known: shares, the error of leaving cells out, what may be left out."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from brdf.errors import UsageError
from plugins import scene as scenes
from plugins.effects import pilot
from plugins.effects.table import CELLS
from plugins.scenes import FOLDER

SIZE = 24
SCENE: Any = None
Y, X = np.mgrid[0:SIZE, 0:SIZE] / SIZE


def truth() -> dict[str, np.ndarray]:
    """Layers without noise: a lit floor, a highlight, a soft glow, and a lamp."""
    floor = (0.4 + 0.3 * X)[..., None] * np.array([1.0, 0.8, 0.6])
    highlight = np.exp(-40 * ((X - 0.3) ** 2 + (Y - 0.4) ** 2))[..., None] * np.ones(3)
    glow = 0.05 * (1 + Y)[..., None] * np.array([0.5, 1.0, 0.7])
    lamp = np.where((X > 0.8) & (Y < 0.15), 50.0, 0.0)[..., None] * np.ones(3)
    found = {cell: np.zeros((SIZE, SIZE, 3)) for cell in CELLS}
    return found | {"diffuse.point": floor, "glossy.point": highlight, "diffuse.indirect": glow, "emitter": lamp}


def noisy(spread: float) -> Any:
    """A renderer: each layer times noise of mean 1, other noise for another seed."""

    def layers(scene: Any, spp: int, seed: int, size: int) -> dict[str, np.ndarray]:
        draw = np.random.default_rng(seed)
        shape = 1 / spread**2  # of a gamma distribution with mean 1 and this standard deviation
        return {k: v * draw.gamma(shape, 1 / shape, v.shape) for k, v in truth().items()}

    return layers


def known_error(cells: set[str], white: float) -> float:
    whole = np.sum(list(truth().values()), axis=0)
    return pilot.difference(whole, whole - np.sum([truth()[c] for c in cells], axis=0), white)


def test_without_noise_everything_is_exact() -> None:
    found = pilot.run(lambda *_: truth(), SCENE)
    whole = sum(light.sum() for light in truth().values())
    for cell, (value, se) in pilot.shares(found).items():
        assert value == pytest.approx(truth()[cell].sum() / whole, rel=1e-12)
        assert se == pytest.approx(0, abs=1e-12)
    for cells in (
        {"diffuse.indirect"},
        {"glossy.point"},
        {"glossy.point", "diffuse.indirect"},
        {"emitter"},
        set(CELLS),
    ):
        value, se = pilot.drop_error(found, cells)
        assert value == pytest.approx(known_error(cells, found.white), rel=1e-9)
        assert se == pytest.approx(0, abs=1e-9)
    assert pilot.drop_error(found, {"mirror.area"}) == (0, 0)


def test_difference_by_hand() -> None:
    """Two pixels, white at 2: (1 - .5) / 1, and one that is clipped in both."""
    whole = np.array([[[1.0] * 3, [10.0] * 3]])
    assert pilot.difference(whole, np.array([[[0.5] * 3, [9.0] * 3]]), 2.0) == pytest.approx(np.sqrt(0.25 / 2))
    # Clipped in the whole one alone: (2 - 1.5) / 2.
    assert pilot.difference(whole, np.array([[[1.0] * 3, [1.5] * 3]]), 2.0) == pytest.approx(np.sqrt(0.0625 / 2))
    # In the dark relative to 5 % of white: .01 / .1.
    assert pilot.difference(np.full((1, 1, 3), 0.02), np.full((1, 1, 3), 0.01), 2.0) == pytest.approx(0.1)


def test_errors_add_up_as_the_light_does() -> None:
    """Two equal layers that overlap: twice the error of one, not sqrt(2) times."""
    same = {"diffuse.point": np.ones((8, 8, 3)), "diffuse.area": np.full((8, 8, 3), 0.1)}
    same["glossy.area"] = same["diffuse.area"]
    found = pilot.run(lambda *_: same, SCENE)
    one = pilot.drop_error(found, {"diffuse.area"}).value
    assert pilot.drop_error(found, {"diffuse.area", "glossy.area"}).value == pytest.approx(2 * one)


@pytest.mark.parametrize("spread", [0.1, 0.5])
def test_shares_lie_within_their_standard_errors(spread: float) -> None:
    whole = sum(light.sum() for light in truth().values())
    cells = ("diffuse.point", "glossy.point", "diffuse.indirect", "emitter")
    z = []
    for seed in range(40):
        found = pilot.shares(pilot.run(noisy(spread), SCENE, seed=seed))
        assert sum(estimate.value for estimate in found.values()) == pytest.approx(1)
        z += [(found[c].value - truth()[c].sum() / whole) / found[c].se for c in cells]
    # With a standard error from 4 runs z has Student's distribution of 3 degrees of freedom: its quartiles are at .765,
    # and 3.18 is passed in 5 %. The cells of one run are correlated: of 160, as good as 60.
    assert abs(np.median(z)) < 3 * 1.36 / np.sqrt(60)  # the median's sd is 1 / (2 f(0)) / sqrt(n), f(0) = .368
    assert 0.5 < np.median(np.abs(z)) < 1.1
    assert np.mean(np.abs(z) > 3.18) < 0.15


@pytest.mark.parametrize("cells", [{"diffuse.indirect"}, {"glossy.point"}, {"glossy.point", "diffuse.indirect"}])
def test_predicted_errors_are_right_on_average_under_little_noise(cells: set[str]) -> None:
    """A tenth of noise: of 1 / pixel^2 it makes 1 + 3 * .01 / 2 at most, which is .75 % of the root."""
    found = [pilot.run(noisy(0.1), SCENE, seed=seed) for seed in range(30)]
    got = [pilot.drop_error(one, cells) for one in found]
    wanted = np.mean([known_error(cells, one.white) for one in found])
    mean, sd = np.mean([g.value for g in got]), np.std([g.value for g in got]) / np.sqrt(len(got))
    assert -4 * sd < mean - wanted < 4 * sd + 0.0075 * wanted
    assert np.mean([g.se for g in got]) == pytest.approx(np.std([g.value for g in got], ddof=1), rel=0.5)


@pytest.mark.parametrize("cells", [{"diffuse.indirect"}, {"glossy.point"}])
def test_under_much_noise_they_err_on_the_large_side(cells: set[str]) -> None:
    """A naive mean of squares would be sqrt(1 + spread^2) too large; the bound is hardly ever too small."""
    found = [pilot.run(noisy(0.7), SCENE, seed=seed) for seed in range(30)]
    got = [pilot.drop_error(one, cells) for one in found]
    wanted = [known_error(cells, one.white) for one in found]
    ratio = np.mean([g.value for g in got]) / np.mean(wanted)
    assert 0.97 < ratio < 1.25
    # Were it right on average, 93 % (Student, 3 degrees of freedom).
    assert np.mean([g.value + 2 * g.se > w for g, w in zip(got, wanted, strict=True)]) >= 0.93


def test_what_is_hardly_ever_met_is_neither_nothing_nor_its_noise() -> None:
    """A layer that is hit once in a long while: products of two runs are 0 almost everywhere."""

    def rare(scene: Any, spp: int, seed: int, size: int) -> dict[str, np.ndarray]:
        hit = np.random.default_rng(seed).random((SIZE, SIZE, 1)) < 0.01
        return {"diffuse.point": np.ones((SIZE, SIZE, 3)), "diffuse.indirect": 0.5 * hit * np.ones(3)}

    got = [pilot.drop_error(pilot.run(rare, SCENE, seed=s), {"diffuse.indirect"}) for s in range(30)]
    # Its mean is .005 of the pixel, known to 21 % from 23 hits. Squares of single runs would say .5 * sqrt(.01) = .05.
    assert 0.0045 < np.mean([g.value for g in got]) < 0.02
    # With a standard error from 4 runs, 2 of them are a bound in 93 % (Student, 3 degrees of freedom); of 30, in fewer
    # than 24 with a probability of .5 %.
    assert np.mean([g.value + 2 * g.se > 0.005 for g in got]) >= 0.8
    assert max(g.value + g.se for g in got) < 0.05


def test_a_lamp_that_fills_part_of_a_pixel() -> None:
    """Bright beyond measure, and met in some runs alone: what is clipped must not count. Here 16 samples find it with 0.1
    each, so that a fifth of the runs does not."""

    def edge(scene: Any, spp: int, seed: int, size: int) -> dict[str, np.ndarray]:
        found = np.random.default_rng(seed).binomial(16, 0.1, (SIZE, SIZE, 1)) / 16
        return {"diffuse.point": truth()["diffuse.point"], "emitter": 500 * found * (Y < 0.05)[..., None] * np.ones(3)}

    runs = [pilot.run(edge, SCENE, seed=seed) for seed in range(20)]
    got = [pilot.drop_error(one, {"emitter"}) for one in runs]
    floor = truth()["diffuse.point"]
    wanted = pilot.difference(floor + 50 * (Y < 0.05)[..., None], floor, runs[0].white)
    assert np.mean([g.value for g in got]) == pytest.approx(wanted, rel=0.15)
    assert max(g.se for g in got) < 0.3 * wanted


def test_a_mirror_loses_what_is_left_out_of_its_image() -> None:
    layers = {
        "diffuse.point": np.ones((4, 4, 3)),
        "mirror.indirect/diffuse.point": np.full((4, 4, 3), 0.5),
        "mirror.indirect/diffuse.area": np.full((4, 4, 3), 0.5),
    }
    found = pilot.run(lambda *_: layers, SCENE)
    assert pilot.shares(found)["mirror.indirect"].value == pytest.approx(0.5)
    assert pilot.shares(found)["diffuse.area"].value == 0
    assert pilot.drop_error(found, {"diffuse.area"}).value == pytest.approx(0.25)
    assert pilot.drop_error(found, {"mirror.indirect"}).value == pytest.approx(0.5)
    assert pilot.drop_error(found, {"diffuse.point"}).value == pytest.approx(0.75)


def test_what_may_be_left_out() -> None:
    found = pilot.run(noisy(0.1), SCENE)
    errors = {cell: pilot.drop_error(found, {cell}) for cell in ("diffuse.indirect", "glossy.point", "diffuse.point")}
    assert errors["diffuse.indirect"].value < errors["glossy.point"].value < errors["diffuse.point"].value
    assert pilot.droppable(found, 1e-3, False) == (frozenset(), (0, 0))
    least = errors["diffuse.indirect"]
    cells, error = pilot.droppable(found, least.value + 2.01 * least.se, False)
    assert (cells, error) == ({"diffuse.indirect"}, least)
    assert pilot.droppable(found, least.value + 1.9 * least.se, False).cells == set()
    # Caustics: not on the pilot's word alone.
    assert "diffuse.indirect" not in pilot.droppable(found, 10.0, True).cells
    both = pilot.droppable(found, 0.35, False)
    assert both.cells == {"diffuse.indirect", "glossy.point"}
    assert both.error == pilot.drop_error(found, both.cells)
    # Never the lamps, and never more than the tolerance.
    assert pilot.droppable(found, 10.0, False).cells == {"diffuse.indirect", "glossy.point", "diffuse.point"}


def test_white_is_not_the_lamp() -> None:
    assert pilot.white_of(truth()) < 2
    assert pilot.white_of({"emitter": np.full((2, 2, 3), 3.0)}) == 3
    assert pilot.white_of({"diffuse.point": np.zeros((2, 2, 3))}) == 1


def test_too_few_runs() -> None:
    with pytest.raises(UsageError, match="at least 4"):
        pilot.run(noisy(0.1), SCENE, runs=3)


def two_layers() -> Any:
    """An integrator that gives 1 to what the eye sees and 2 to what it misses, in layers."""

    class Layered(mi.SamplingIntegrator):  # exists only once a variant is set
        def aov_names(self) -> list[str]:
            return [f"{cell}.{c}" for cell in ("diffuse.point", "emitter") for c in "RGB"]

        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            hit = scene.ray_test(ray, active)
            one, two = mi.Float(hit & active), 2 * mi.Float(~hit & active)
            return mi.Spectrum(one + two), hit, [one, one, one, two, two, two]

    return Layered(mi.Properties())


@pytest.mark.parametrize(
    "crop", ["", '<integer name="crop_width" value="30"/><integer name="crop_offset_x" value="20"/>']
)
def test_layers_of_an_integrator(crop: str, tmp_path: Any) -> None:
    """The channels by their names, in a small picture of the same; afterwards the film is as it was."""
    mi.set_variant("llvm_ad_rgb")
    text = (
        (FOLDER / "effects" / "point.xml").read_text().replace('<rfilter type="box" />', f'<rfilter type="box"/>{crop}')
    )
    (tmp_path / "scene.xml").write_text(text.replace('"height" value="$size"', '"height" value="50"'))
    loaded = scenes.load(tmp_path / "scene.xml", size=100)
    sensor = loaded.sensors["camera"]
    layers = pilot.rendered(two_layers(), sensor)(loaded.scene, 64, 0, 20)
    assert list(layers) == ["diffuse.point", "emitter"]
    assert layers["emitter"].shape == ((20, 12, 3) if crop else (10, 20, 3))
    np.testing.assert_allclose(layers["diffuse.point"] + layers["emitter"] / 2, 1, rtol=1e-6)
    whole = np.array(mi.render(loaded.scene, sensor=sensor, integrator=two_layers(), spp=16))
    assert whole.shape[:2] == ((50, 30) if crop else (50, 100))
    # A ball fills as much of either picture; of the small one a pixel is 1 / 240.
    assert whole[..., -6].mean() == pytest.approx(layers["diffuse.point"][..., 0].mean(), abs=0.02)
    assert 0.1 < whole[..., -6].mean() < 0.9


def test_shares_of_the_time() -> None:
    """Seconds by a formula, the first call of each set slower."""
    calls: list[frozenset[str]] = []

    def seconds(cells: frozenset[str]) -> float:
        calls.append(cells)
        compiling = 100.0 if calls.count(cells) == 1 else 0.0
        return compiling + 1 + ("a" in cells) + 2 * ("b" in cells)

    for repeats in (1, 3):
        calls.clear()
        assert pilot.times(seconds, "ab", repeats) == {"a": pytest.approx(0.25), "b": pytest.approx(0.5)}
    assert pilot.times(seconds, ["a"]) == {"a": 1.0}


def test_a_small_picture_of_any_crop() -> None:
    """It stays on the film, which is as it was afterwards; also after an exception."""
    mi.set_variant("llvm_ad_rgb")
    rng = np.random.default_rng(3)
    for _ in range(200):
        size = rng.integers(1, 300, 2)
        offset = rng.integers(0, size)
        crop = rng.integers(1, size - offset + 1)
        film = dict(zip(("width", "height"), map(int, size), strict=True))
        film |= {f"crop_offset_{a}": int(n) for a, n in zip("xy", offset, strict=True)}
        film |= {f"crop_{a}": int(n) for a, n in zip(("width", "height"), crop, strict=True)}
        sensor = mi.load_dict({"type": "perspective", "film": {"type": "hdrfilm", **film}})
        before = [list(f) for f in (sensor.film().size(), sensor.film().crop_size(), sensor.film().crop_offset())]
        with pytest.raises(KeyError), pilot.shrunk(sensor, 32):
            assert 1 <= max(sensor.film().crop_size()) <= 32
            raise KeyError
        assert before == [
            list(f) for f in (sensor.film().size(), sensor.film().crop_size(), sensor.film().crop_offset())
        ]
