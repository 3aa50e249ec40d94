"""``brdf render``: the picture is right however many passes it takes, and bad input is one line."""

import json
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from brdf.errors import DataError, UsageError
from fitting import rendering
from fitting.cli.app import main

SCENE = """<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective" id="front">
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="20"/><integer name="height" value="12"/></film>
    <sampler type="independent"><integer name="sample_count" value="7"/></sampler>
  </sensor>
  <sensor type="perspective" id="away">
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,9" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
  </sensor>
  <emitter type="constant"><rgb name="radiance" value="0.25,0.5,2"/></emitter>
  {shape}
</scene>"""

BALL = '<shape type="sphere"><bsdf type="cooktorrance"><float name="m" value="0.2"/></bsdf></shape>'


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(shape=BALL))
    return path


def picture(path: Path) -> np.ndarray:
    return np.array(mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))


def test_the_scenes_sensor_and_samples(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = scene.with_name("out.exr")
    assert main(["render", str(scene), "-o", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["sensor"], report["spp"], report["width"], report["height"]) == ("front", 7, 20, 12)
    assert picture(out).shape == (12, 20, 3)
    assert sorted(p.name for p in scene.parent.iterdir()) == ["out.exr", "scene.xml"]


def test_values_for_names_in_the_scene(tmp_path: Path) -> None:
    """A black ball, and a white one, from one file."""
    scene, out = tmp_path / "scene.xml", tmp_path / "out.exr"
    ball = '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></shape>'
    scene.write_text(SCENE.format(shape=ball))
    middle = []
    for grey in (0.0, 1.0):
        assert main(["render", str(scene), "-o", str(out), "-D", f"grey={grey}", "--spp", "512"]) == 0
        middle.append(picture(out)[6, 10])
    np.testing.assert_array_equal(middle[0], 0)
    # A white diffuse ball in even light is as bright as the light; of the noise, 5 % at 7 samples, 0.6 % is left.
    np.testing.assert_allclose(middle[1], [0.25, 0.5, 2.0], rtol=0.03)
    assert main(["render", str(scene), "-o", str(out), "-D", "grey"]) == UsageError.exit_code
    assert main(["render", str(scene), "-o", str(out)]) == DataError.exit_code


def test_channels_keep_their_names(tmp_path: Path) -> None:
    """An integrator's extra channels are written under the names Mitsuba gives them."""
    scene, out = tmp_path / "scene.xml", tmp_path / "out.exr"
    both = '<integrator type="aov"><string name="aovs" value="far:depth"/><integrator type="path"/></integrator>'
    scene.write_text(SCENE.format(shape=BALL).replace('<integrator type="path"/>', both))
    assert main(["render", str(scene), "-o", str(out)]) == 0
    names = [channel.name for channel in mi.Bitmap(str(out)).struct_()]
    assert {"R", "G", "B", "far.T"} <= set(names)


def test_an_empty_world_is_as_bright_as_its_light(tmp_path: Path) -> None:
    """Radiance (0.25, 0.5, 2) from everywhere: every pixel is that, whatever filter and passes weigh."""
    scene, out = tmp_path / "scene.xml", tmp_path / "out.exr"
    scene.write_text(SCENE.format(shape=""))
    assert main(["render", str(scene), "-o", str(out), "--sensor", "away", "--spp", "5"]) == 0
    assert picture(out).shape == (8, 8, 3)
    # The file may hold half floats: 2^-11 relative.
    np.testing.assert_allclose(picture(out), np.broadcast_to([0.25, 0.5, 2.0], (8, 8, 3)), rtol=2**-11)


@pytest.mark.parametrize("spp", [1, 2, 3])
def test_passes_add_up_to_all_samples(spp: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The film's weights, which count the samples, do not depend on how they were split."""
    mi.set_variant("llvm_ad_rgb")
    scene = mi.load_string(SCENE.format(shape=""))
    sensor = scene.sensors()[0]
    counted: list[int] = []
    original = mi.render
    monkeypatch.setattr(mi, "render", lambda *a, **k: (counted.append(k["spp"]), original(*a, **k))[1])
    monkeypatch.setattr(rendering, "SAMPLES_PER_PASS", 20 * 12)
    np.testing.assert_allclose(rendering.render(scene, sensor, 3 * spp).picture[..., 1], 0.5, rtol=1e-6)
    assert counted == [1] * (3 * spp)
    counted.clear()
    monkeypatch.setattr(rendering, "SAMPLES_PER_PASS", 4 * 20 * 12)
    rendering.render(scene, sensor, 3 * spp)
    assert sum(counted) == 3 * spp
    assert max(counted) <= 4


def test_passes_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pixel is the sum of weighted samples over the sum of weights, over all passes: not the mean of their pixels.

    At an edge, and with a filter wider than a pixel, the two differ.
    """
    mi.set_variant("llvm_ad_rgb")
    edge = '<shape type="rectangle"><bsdf type="diffuse"><float name="reflectance" value="0"/></bsdf></shape>'
    scene = mi.load_string(SCENE.format(shape=edge))
    sensor = scene.sensors()[0]
    sums: list[np.ndarray] = []
    original = mi.render

    def render_and_keep(*given: object, **named: object) -> object:
        result = original(*given, **named)
        sums.append(np.array(sensor.film().develop(raw=True), dtype=float))
        return result

    monkeypatch.setattr(mi, "render", render_and_keep)
    monkeypatch.setattr(rendering, "SAMPLES_PER_PASS", 20 * 12)
    got = rendering.render(scene, sensor, 4).picture
    assert len(sums) == 4
    total = np.sum(sums, axis=0)
    np.testing.assert_allclose(got, total[..., :3] / total[..., 3:], rtol=1e-5)
    means = np.mean([one[..., :3] / one[..., 3:] for one in sums], axis=0)
    assert np.abs(got - means).max() > 1e-3


def test_another_seed_is_other_noise_and_the_same_seed_the_same(scene: Path) -> None:
    def with_seed(seed: int) -> np.ndarray:
        out = scene.with_name(f"{seed}.exr")
        assert main(["render", str(scene), "-o", str(out), "--seed", str(seed)]) == 0
        return picture(out)

    first = with_seed(1)
    # Cores add to a pixel in any order, so that float32 sums differ in the last digits.
    np.testing.assert_allclose(first, with_seed(1), rtol=1e-5)
    assert np.abs(first / with_seed(2) - 1).max() > 1e-3


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["no.xml", "-o", "x.exr"], DataError.exit_code, "no.xml: no such file"),
        (["scene.xml", "-o", "x.gif"], UsageError.exit_code, "x.gif: a picture is written as .exr or .png"),
        (["scene.xml", "-o", "no/x.exr"], DataError.exit_code, "there is no folder no"),
        (["scene.xml", "-o", "x.exr", "--sensor", "up"], UsageError.exit_code, "There are: front, away."),
        (["scene.xml", "-o", "x.exr", "--variant", "up"], UsageError.exit_code, "There are: scalar_rgb"),
        (["broken.xml", "-o", "x.exr"], DataError.exit_code, "broken.xml:1: not well-formed XML"),
        (["blind.xml", "-o", "x.exr"], DataError.exit_code, "blind.xml: the scene has no sensor"),
        (["typo.xml", "-o", "x.exr"], DataError.exit_code, "'mm' is not a parameter of this model. Did you mean m?"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str],
    code: int,
    said: str,
    scene: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(scene.parent)
    Path("broken.xml").write_text("<scene")
    Path("blind.xml").write_text('<scene version="3.0.0"/>')
    Path("typo.xml").write_text(SCENE.format(shape=BALL.replace('"m"', '"mm"')))
    assert main(["render", *arguments]) == code
    ended = capsys.readouterr()
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert ended.out == ""
    assert not Path("x.exr").exists()
