"""Pictures in and out. Files are made by OpenImageIO itself, so what is read is compared with what was put in."""

import os
import re
import stat

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from brdf.errors import DataError, UsageError
from fitting import images

# sRGB code values and their linear light: c / 255 / 12.92 up to 10, ((c / 255 + 0.055) / 1.055)^2.4 from 11, worked out
# in decimal arithmetic.
SRGB_8BIT = {0: 0.0, 10: 0.00303527, 11: 0.00334654, 128: 0.21586050, 188: 0.50288646, 255: 1.0}


def store(path, pixels, kind, names=None, **attributes):
    """Write `pixels` just as they are."""
    pixels = np.ascontiguousarray(pixels)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    if names:
        spec.channelnames = tuple(names)
    for name, value in attributes.items():
        spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output is not None, oiio.geterror()
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(pixels), output.geterror()
    output.close()
    return path


def noise(*shape):
    return np.random.default_rng(3).random(shape, dtype=np.float32)


def one_line(message, *parts):
    """The error says all of `parts`, in one line."""
    text = str(message.value)
    assert "\n" not in text
    for part in parts:
        assert str(part) in text, f"{part!r} is not in {text!r}"


@pytest.mark.parametrize("ending", ["exr", "tif"])
def test_floating_point_stays_as_it_is(tmp_path, ending):
    pixels = noise(5, 7, 3) * 100 - 1
    image = images.read(store(tmp_path / f"a.{ending}", pixels, "float"))
    np.testing.assert_array_equal(image.rgb, pixels)
    assert image.rgb.dtype == np.float32
    assert image.alpha is None
    assert image.decoded == "linear as stored"
    assert image.size == (7, 5)


def test_hdr_is_linear_within_its_eight_bit_mantissa(tmp_path):
    pixels = noise(5, 7, 3) + 0.5
    image = images.read(store(tmp_path / "a.hdr", pixels, "float"))
    np.testing.assert_allclose(image.rgb, pixels, atol=2 * 2.0**-8)
    assert image.decoded == "linear as stored"


@pytest.mark.parametrize("ending", ["png", "tif", "bmp", "tga", "ppm"])
def test_eight_bits_are_decoded_from_srgb(tmp_path, ending):
    codes = np.array(list(SRGB_8BIT), np.uint8)
    image = images.read(store(tmp_path / f"a.{ending}", np.repeat(codes[None, :, None], 3, axis=2), "uint8"))
    np.testing.assert_allclose(image.rgb[0, :, 1], list(SRGB_8BIT.values()), rtol=1e-5, atol=1e-8)
    assert image.decoded == "decoded from sRGB"


def test_jpeg_is_decoded_from_srgb(tmp_path):
    image = images.read(store(tmp_path / "a.jpg", np.full((16, 16, 3), 188, np.uint8), "uint8"))
    np.testing.assert_allclose(image.rgb, SRGB_8BIT[188], rtol=0.02)  # JPEG may be one code value off
    assert image.decoded == "decoded from sRGB"


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_sixteen_bits_are_decoded_from_srgb(tmp_path, ending):
    codes = np.full((2, 2, 3), 188 * 257, np.uint16)  # 257 = 65535 / 255
    image = images.read(store(tmp_path / f"a.{ending}", codes, "uint16"))
    np.testing.assert_allclose(image.rgb, SRGB_8BIT[188], rtol=1e-5)


def test_the_colour_space_in_the_file_is_honoured(tmp_path):
    codes = np.full((2, 2, 3), 128, np.uint8)
    linear = images.read(store(tmp_path / "lin.png", codes, "uint8", **{"oiio:ColorSpace": "lin_rec709_scene"}))
    np.testing.assert_allclose(linear.rgb, 128 / 255, rtol=1e-6)
    assert linear.decoded == "linear as stored"
    gamma = images.read(store(tmp_path / "g22.png", codes, "uint8", **{"oiio:ColorSpace": "g22_rec709_scene"}))
    np.testing.assert_allclose(gamma.rgb, (128 / 255) ** 2.2, rtol=1e-5)
    assert gamma.decoded == "decoded from a gamma of 2.2"
    floating = images.read(
        store(tmp_path / "f.tif", np.full((2, 2, 3), 128 / 255, np.float32), "float", **{"oiio:ColorSpace": "sRGB"})
    )
    np.testing.assert_allclose(floating.rgb, SRGB_8BIT[128], rtol=1e-5)
    exr = images.read(store(tmp_path / "e.exr", np.full((2, 2, 3), 0.5), "float", **{"oiio:ColorSpace": "sRGB"}))
    assert (exr.rgb == 0.5).all()


def test_colours_are_neither_multiplied_nor_divided_by_alpha(tmp_path):
    rgba = np.tile(np.array([188, 128, 11, 64], np.uint8), (2, 2, 1))
    png = images.read(store(tmp_path / "a.png", rgba, "uint8", **{"oiio:UnassociatedAlpha": 1}))
    np.testing.assert_allclose(png.rgb[0, 0], [SRGB_8BIT[188], SRGB_8BIT[128], SRGB_8BIT[11]], rtol=1e-5)
    assert png.alpha is not None
    np.testing.assert_allclose(png.alpha, 64 / 255, rtol=1e-6)
    stored = np.tile(np.array([0.5, 0.25, 0.125, 0.25], np.float32), (2, 2, 1))
    exr = images.read(store(tmp_path / "a.exr", stored, "float"))
    np.testing.assert_array_equal(exr.rgb, stored[..., :3])
    assert exr.alpha is not None and (exr.alpha == 0.25).all()


def test_of_many_channels_red_green_blue_are_taken(tmp_path):
    pixels = noise(3, 4, 6)
    names = ["Z", "B", "A", "R", "normal.X", "G"]
    image = images.read(store(tmp_path / "a.exr", pixels, "float", names))
    np.testing.assert_array_equal(image.rgb, pixels[..., [3, 5, 1]])
    np.testing.assert_array_equal(image.alpha, pixels[..., 2])


def test_the_only_layer_is_taken(tmp_path):
    pixels = noise(3, 4, 4)
    image = images.read(store(tmp_path / "a.exr", pixels, "float", ["beauty.B", "beauty.G", "beauty.R", "depth.Z"]))
    np.testing.assert_array_equal(image.rgb, pixels[..., [2, 1, 0]])


def test_two_layers_are_refused_with_their_channels(tmp_path):
    path = store(tmp_path / "a.exr", noise(3, 4, 6), "float", ["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"])
    with pytest.raises(DataError) as message:
        images.read(path)
    one_line(message, path, "a.R", "b.B", "6 channels", "expected 3")


def test_of_two_parts_the_one_with_colours_is_taken(tmp_path):
    path, colours = str(tmp_path / "a.exr"), noise(3, 4, 3)
    specs = [oiio.ImageSpec(4, 3, 1, "float"), oiio.ImageSpec(4, 3, 3, "float")]
    specs[0].channelnames = ("Z",)
    for name, spec in zip(("depth", "beauty"), specs, strict=True):
        spec.attribute("oiio:subimagename", name)
    output = oiio.ImageOutput.create(path)
    assert output is not None
    assert output.open(path, tuple(specs))
    assert output.write_image(noise(3, 4, 1))
    assert output.open(path, specs[1], "AppendSubimage")
    assert output.write_image(colours)
    output.close()
    np.testing.assert_array_equal(images.read(path).rgb, colours)


@pytest.mark.parametrize(("ending", "count"), [("png", 1), ("png", 2), ("exr", 1), ("exr", 2), ("jpg", 1), ("tif", 1)])
def test_one_or_two_channels_are_refused(tmp_path, ending, count):
    kind = "float" if ending == "exr" else "uint8"
    path = store(
        tmp_path / f"a.{ending}", (noise(3, 4, count) * 255).astype(np.float32 if ending == "exr" else np.uint8), kind
    )
    with pytest.raises(DataError) as message:
        images.read(path)
    one_line(message, path, f"got {count} channel", "expected 3")


@pytest.mark.parametrize("turn", range(1, 9))
def test_a_picture_on_its_side_is_put_upright(tmp_path, turn):
    path = store(tmp_path / "a.tif", noise(3, 5, 3), "float", Orientation=turn)
    oracle = oiio.ImageBufAlgo.reorient(oiio.ImageBuf(str(path))).get_pixels("float")
    np.testing.assert_array_equal(images.read(path).rgb, oracle)


def test_missing(tmp_path):
    with pytest.raises(DataError) as message:
        images.read(tmp_path / "none.exr")
    one_line(message, tmp_path / "none.exr", "no such picture")


def test_a_folder_is_no_picture(tmp_path):
    with pytest.raises(DataError) as message:
        images.read(tmp_path)
    one_line(message, tmp_path, "folder")


@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.txt", "a"])
def test_what_is_no_picture(tmp_path, name):
    (tmp_path / name).write_text("not a picture\nat all\n")
    with pytest.raises(DataError) as message:
        images.read(tmp_path / name)
    one_line(message, tmp_path / name, "cannot be read")


@pytest.mark.parametrize(
    ("ending", "kind"), [("exr", "float"), ("png", "uint8"), ("jpg", "uint8"), ("tif", "uint8"), ("hdr", "float")]
)
def test_half_a_file(tmp_path, ending, kind):
    pixels = noise(64, 64, 3)
    path = store(tmp_path / f"a.{ending}", (pixels * 255).astype(np.uint8) if kind == "uint8" else pixels, kind)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError) as message:
        images.read(path)
    one_line(message, path, "cannot be read")


def picture(rgb):
    return images.Image(np.asarray(rgb, np.float32), None, "linear as stored")


def test_check_passes_what_can_be_fitted():
    images.check(picture(noise(3, 5, 3)), "a.exr", (5, 3))
    one_lit = np.zeros((3, 5, 3))
    one_lit[2, 4, 0] = 1e-6
    images.check(picture(one_lit), "a.exr", (5, 3))


def test_check_size():
    with pytest.raises(DataError) as message:
        images.check(picture(noise(3, 5, 3)), "a.exr", (3, 5))
    one_line(message, "a.exr", "got 5 x 3", "expected 3 x 5")


@pytest.mark.parametrize(("value", "word"), [(np.nan, "NaN"), (np.inf, "Inf"), (-np.inf, "Inf"), (-1e-6, "negative")])
def test_check_bad_pixels(value, word):
    rgb = noise(6, 9, 3)
    rgb[4, 2, 1] = value  # first in reading order
    rgb[5, 1] = value  # three channels, one pixel
    with pytest.raises(DataError) as message:
        images.check(picture(rgb), "a.exr", (9, 6))
    one_line(message, "a.exr", "2 pixels", word, "x = 2, y = 4")
    used = np.ones((6, 9), bool)
    used[4, 2] = False
    with pytest.raises(DataError) as message:
        images.check(picture(rgb), "a.exr", (9, 6), used)
    one_line(message, "1 pixel is", word, "x = 1, y = 5")
    used[5, 1] = False
    images.check(picture(rgb), "a.exr", (9, 6), used)


def test_check_black():
    with pytest.raises(DataError) as message:
        images.check(picture(np.zeros((3, 5, 3))), "a.exr", (5, 3))
    one_line(message, "a.exr", "every pixel is black")
    half = np.zeros((3, 5, 3))
    half[:, 2:] = 1
    with pytest.raises(DataError) as message:
        images.check(picture(half), "a.exr", (5, 3), half[..., 0] == 0)
    one_line(message, "a.exr", "every pixel used is black")


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_mask_is_the_first_channel_above_one_half(tmp_path, channels):
    codes = np.zeros((2, 3, channels), np.uint8)
    codes[..., 0] = [[0, 127, 128], [255, 200, 1]]
    codes[..., 1:] = 255
    mask = images.read_mask(store(tmp_path / "m.png", codes, "uint8", **{"oiio:UnassociatedAlpha": 1}), (3, 2))
    np.testing.assert_array_equal(mask, [[False, False, True], [True, True, False]])
    assert mask.dtype == bool


def test_mask_of_another_size(tmp_path):
    path = store(tmp_path / "m.png", np.zeros((2, 3, 1), np.uint8), "uint8")
    with pytest.raises(DataError) as message:
        images.read_mask(path, (2, 3))
    one_line(message, path, "got 3 x 2", "expected 2 x 3")


@pytest.mark.parametrize("channels", [3, 4])
def test_exr_comes_back_bit_for_bit(tmp_path, channels):
    pixels = noise(5, 7, channels) * 1e4 - 3
    path = tmp_path / "a.exr"
    images.write(path, pixels)
    image = images.read(path)
    np.testing.assert_array_equal(image.rgb, pixels[..., :3])
    if channels == 4:
        np.testing.assert_array_equal(image.alpha, pixels[..., 3])
    spec = oiio.ImageBuf(str(path)).spec()
    assert str(spec.format) == "float" and spec.get_string_attribute("compression") == "zip"


def test_named_channels(tmp_path):
    pixels = noise(2, 3, 5)
    names = ["R", "G", "B", "error.R", "relative.Y"]
    images.write(tmp_path / "a.exr", pixels, names)
    buffer = oiio.ImageBuf(str(tmp_path / "a.exr"))
    stored, there = buffer.get_pixels("float"), buffer.spec().channelnames
    assert stored is not None and sorted(there) == sorted(names)
    for i, name in enumerate(names):
        np.testing.assert_array_equal(stored[..., there.index(name)], pixels[..., i])


def test_png_comes_back_within_half_a_step(tmp_path):
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    linear = images.read(store(tmp_path / "a.png", np.dstack([codes] * 3), "uint8")).rgb
    images.write(tmp_path / "b.png", linear)
    assert b"sRGB" in (tmp_path / "b.png").read_bytes()  # the chunk by which viewers know
    raw = oiio.ImageBuf(str(tmp_path / "b.png"))
    np.testing.assert_array_equal(raw.get_pixels("uint8"), np.dstack([codes] * 3))
    images.write(tmp_path / "c.png", np.array([[[-1.0, 2.0, np.nan]]]))
    np.testing.assert_array_equal(oiio.ImageBuf(str(tmp_path / "c.png")).get_pixels("uint8"), [[[0, 255, 0]]])


def test_png_with_alpha(tmp_path):
    pixels = np.full((2, 2, 4), 0.25, np.float32)
    images.write(tmp_path / "a.png", pixels)
    image = images.read(tmp_path / "a.png")
    np.testing.assert_allclose(image.rgb, 0.25, atol=0.004)  # half a step of 8 bit there is 0.0019
    assert image.alpha is not None
    np.testing.assert_allclose(image.alpha, 64 / 255, rtol=1e-6)  # 0.25 * 255 rounded


def test_the_two_curves_undo_each_other():
    x = np.linspace(0, 1, 4097)
    np.testing.assert_allclose(images.to_srgb(images.from_srgb(x)), x, atol=1e-6)
    np.testing.assert_allclose(
        images.from_srgb(np.array(list(SRGB_8BIT)) / 255), list(SRGB_8BIT.values()), rtol=1e-5, atol=1e-8
    )


def test_another_ending_is_wrong_use(tmp_path):
    with pytest.raises(UsageError) as message:
        images.write(tmp_path / "a.gif", noise(2, 2, 3))
    one_line(message, ".gif", ".exr", ".png")
    assert not list(tmp_path.iterdir())


def test_folder_missing(tmp_path):
    with pytest.raises(DataError) as message:
        images.write(tmp_path / "no" / "a.exr", noise(2, 2, 3))
    one_line(message, tmp_path / "no", "no such folder")


def test_folder_is_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError) as message:
        images.write(tmp_path / "file" / "a.exr", noise(2, 2, 3))
    one_line(message, tmp_path / "file", "not a folder")


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder that even root cannot write")
def test_folder_that_cannot_be_written():
    with pytest.raises(DataError) as message:
        images.write("/proc/self/a.exr", noise(2, 2, 3))
    one_line(message, "/proc/self", "cannot be written")


def test_failing_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.exr"
    images.write(path, np.ones((2, 2, 3)))
    before = path.read_bytes()

    class Broken:
        open = staticmethod(lambda *_: True)
        write_image = staticmethod(lambda *_: False)
        geterror = staticmethod(lambda: "disk\nfull")

    monkeypatch.setattr(oiio.ImageOutput, "create", lambda *_: Broken)
    with pytest.raises(DataError) as message:
        images.write(path, noise(2, 2, 3))
    one_line(message, path, "disk; full")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_written_files_have_the_usual_permissions(tmp_path):
    images.write(tmp_path / "a.exr", noise(2, 2, 3))
    (tmp_path / "plain").write_text("")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("a.exr", "plain")]
    assert modes[0] == modes[1]


def test_a_message_is_one_line():
    assert re.fullmatch(r"a; b", images._one_line("a\n  b.\n"))
