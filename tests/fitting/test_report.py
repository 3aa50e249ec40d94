"""The report, from a solution made up here: what it says, that it stands alone, that nothing in it can break it."""

import base64
import dataclasses
import html.parser
import io
import re

import matplotlib.image
import numpy as np
import pytest

from brdf.errors import DataError
from fitting import report
from fitting.report import page, pictures, plots
from fitting.solution import Estimate, Lobes, MaterialCheck, Solution, Step, View

NAN = float("nan")


def sphere(size, m, colour, light=(0.5, 0.6, 0.62)):
    """A shaded ball, and where it is."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j] * 1.15
    inside = x**2 + y**2 < 1
    n = np.dstack([x, y, np.sqrt(np.where(inside, 1 - x**2 - y**2, 1))])
    toward = np.array(light) / np.linalg.norm(light)
    cosine = np.clip(n @ toward, 0, None)
    h = toward + np.array([0, 0, 1])
    nh = np.clip(n @ (h / np.linalg.norm(h)), 1e-3, 1)
    lobe = np.exp((1 - nh**-2) / m**2) / (m**2 * nh**4)
    picture = (cosine[..., None] * np.array(colour) + 0.08 * lobe[..., None] * (cosine[..., None] > 0)) * inside[
        ..., None
    ]
    return picture.astype(np.float32), inside & (x**2 + y**2 < 0.97)


def view(size=96, i=0):
    light = (0.5 - 0.4 * i, 0.6, 0.62)
    render, used = sphere(size, 0.3, (0.5, 0.2, 0.1), light)
    target, _ = sphere(size, 0.31, (0.5, 0.21, 0.1), light)
    target *= 1 + 0.02 * np.random.default_rng(i).normal(size=target.shape).astype(np.float32)
    rms = float(np.sqrt(np.mean((render - target)[used] ** 2) / np.mean(target[used] ** 2)))
    return View(f"camera{i}", f"pictures/ball{i}.exr", target, render, used, rms)


def number(value, sd, start, meaning, bounds=(1e-4, 1.5), at_bound=False):
    v, s = np.array([value]), np.array([sd])
    return Estimate(v, s, v - 1.97 * s, v + 1.97 * s, np.array([start]), "number", "1", meaning, bounds, at_bound)


def colour(value, sd, start, meaning):
    v, s = np.array(value), np.array(sd)
    return Estimate(v, s, v - 1.97 * s, v + 1.97 * s, np.array(start), "colour", "1", meaning, (0.0, 1.0), False)


def lobes_of(m):
    outgoing, incident = np.radians(np.linspace(-89.5, 89.5, 359)), np.radians([0.0, 30.0, 60.0])
    half = (outgoing[None] - incident[:, None]) / 2
    f = 0.05 + np.exp(-(np.tan(half) ** 2) / m**2) / (m**2 * np.cos(half) ** 4)
    return Lobes(incident, outgoing, f[..., None] * np.array([1.0, 0.8, 0.7]))


def solution(views=1, materials=1, size=96):
    """A fit as it usually ends."""
    parameters, components = {}, []
    for name in ["ball", "floor", "shape[2].bsdf"][:materials]:
        parameters[f"{name}.m"] = number(0.30012, 0.00041, 0.1, "rms slope of the microfacets")
        parameters[f"{name}.eta"] = number(
            1.5031, 0.0052, 2.0, "index of refraction, inside over outside", (1.0001, 5.0)
        )
        parameters[f"{name}.diffuse_reflectance"] = colour(
            (0.5, 0.2, 0.1), (0.002, 0.001, 0.001), (0.3, 0.3, 0.3), "albedo of what is under the surface"
        )
        components += [f"{name}.m", f"{name}.eta", *(f"{name}.diffuse_reflectance.{c}" for c in "rgb")]
    p = len(components)
    angle = np.random.default_rng(5).normal(size=(p, 40))
    correlation = np.array(np.corrcoef(angle))
    correlation[0, 1] = correlation[1, 0] = -0.97
    history = []
    for i in range(12):
        values = {k: e.value + (e.start - e.value) * 0.35**i for k, e in parameters.items()}
        stage = "grid of starts" if i == 0 else "Levenberg-Marquardt" if i < 8 else "more samples"
        history.append(Step(i, 0.4 * 0.2**i if i < 11 else -1e-9, values, 0.05 * i, stage))
    shown = tuple(view(size, i) for i in range(views))
    checks = {name: MaterialCheck(3e-7, 0.94, 1e-4, 1.4) for name in ["ball", "floor", "shape[2].bsdf"][:materials]}
    return Solution(
        status="Converged after 12 iterations: the last step changed no parameter by more than 0.01 of its sd.",
        converged=True,
        interrupted=False,
        parameters=parameters,
        components=tuple(components),
        covariance=np.eye(p),
        correlation=correlation,
        remarks=("ball.m and ball.eta are hard to tell apart: their correlation is -0.97.",),
        history=tuple(history),
        loss=1e-9,
        rms=float(np.mean([v.rms for v in shown])) if shown else NAN,
        iterations=12,
        seconds=0.734,
        views=shown,
        lobes={name: lobes_of(m) for name, m in zip(checks, (0.3, 0.1, 0.5), strict=False)},
        checks=checks,
        settings={
            "command": "brdf fit scene.xml --target camera0=pictures/ball0.exr --fit ball.m --out out",
            "scene": "scene.xml",
            "targets": {"camera0": "pictures/ball0.exr"},
            "samples_per_pixel": 16,
            "seed": 0,
            "solver": "lm",
        },
        versions={"python": "3.11.2", "brdf-fitting": "0.1.0", "mitsuba": "3.9.1", "drjit": "1.5.0"},
    )


VOID = {"meta", "img", "br", "line", "rect", "path", "use", "link"}


class Reader(html.parser.HTMLParser):
    """Tags with their attributes, the text, and tags that do not match."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text, self.unmatched, self.open = [], "", [], []
        self.feed(text)
        self.unmatched += self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        if not self.open or self.open.pop() != tag:
            self.unmatched.append(tag)

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.text += data

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def words(text):
    """Visible text, its white space made single."""
    return " ".join(Reader(text).text.split())


def decode(uri):
    """The pixels of a data URI, 0 to 255."""
    data = base64.b64decode(uri.removeprefix("data:image/png;base64,"), validate=True)
    return np.round(255 * matplotlib.image.imread(io.BytesIO(data))[..., :3]).astype(int)


def degenerate(**changes):
    """Everything that can be missing is."""
    bare = dataclasses.replace(
        solution(),
        parameters={
            "ball.m": number(0.3, NAN, 0.1, "slope"),
            "ball.eta": number(1.0, 0.0, 1.0, "index", (1.0, 5.0), True),
            "ball.k": number(0.0, 0.01, 0.5, "extinction"),
            "ball.c": colour((0.0, 40.0, NAN), (NAN, 90.0, NAN), (0.1, 0.1, 0.1), "colour"),
        },
        components=("ball.m", "ball.eta", "ball.k", "ball.c.r", "ball.c.g", "ball.c.b"),
        correlation=np.where(np.eye(6) == 1, 1.0, NAN),
        converged=False,
        interrupted=True,
        status="Interrupted by the user after 0 iterations: the values are those of the start.",
        history=(),
        remarks=(),
        lobes={},
        checks={},
        settings={},
        versions={},
        rms=NAN,
        loss=NAN,
        iterations=0,
    )
    return dataclasses.replace(bare, **changes)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("views", "materials"), [(1, 1), (2, 2), (4, 3)])
def test_it_stands_alone_and_is_well_formed(views, materials):
    text = page.html(solution(views, materials, size=40))
    reader = Reader(text)
    assert reader.unmatched == []
    assert reader.all("html") == [{"lang": "en"}]
    assert not reader.all("script") and not reader.all("link") and not reader.all("iframe")
    assert "@import" not in text and not re.search(r"url\((?!#)", text)
    for _, attributes in reader.tags:
        for name in ("src", "href", "xlink:href", "poster", "data"):
            assert attributes.get(name, "#").startswith(("#", "data:image/png;base64,")), attributes
    images = reader.all("img")
    assert len(images) == 4 * views  # target, render, error and its colours
    assert all(image["alt"] for image in images)
    assert all(
        attributes["aria-label"] for attributes in (a for _, a in reader.tags) if attributes.get("role") == "img"
    )
    plots_ = [a for a in reader.all("svg") if a.get("class") != "bar" and a.get("viewbox", "").startswith("0 0 400")]
    assert len(plots_) == 2 + 2 * materials
    assert page.html(solution(views, materials, size=40)) == text


@pytest.mark.parametrize("materials", [1, 3])
def test_ids_are_unique_and_what_refers_to_them_finds_them(materials):
    text = page.html(solution(1, materials, size=40))
    ids = [attributes["id"] for _, attributes in Reader(text).tags if "id" in attributes]
    assert ids and len(ids) == len(set(ids))
    used = re.findall(r"url\(#([^)]+)\)", text) + re.findall(r'xlink:href="#([^"]+)"', text)
    assert used and set(used) <= set(ids)


def test_it_says_what_was_found():
    text = words(page.html(solution(2)))
    for part in (
        "Material fitted to 2 pictures ball m, eta and diffuse_reflectance",
        "Converged after 12 iterations",
        # two digits of the standard deviation, the interval as many places
        "m rms slope of the microfacets 0.30012 ± 0.00041 0.29931 to 0.30093 0.1",
        "eta index of refraction, inside over outside 1.5031 ± 0.0052 1.4929 to 1.5133 2",
        "G 0.2000 ± 0.0010",
        "their correlation is -0.97",
        "−0.97",
        "It is reciprocal",
        "brdf fit scene.xml --target camera0=pictures/ball0.exr",
        "samples per pixel 16",
        "mitsuba 3.9.1",
        "pictures/ball1.exr",
        "96 × 96 pixels; 5 212 used",
        "1 grid of starts; 2 Levenberg-Marquardt; 3 more samples",
        "not positive",
    ):
        assert part in text, f"{part!r} is not in the page"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("changes", [{}, {"views": ()}, {"views": (view(), view(i=1))}])
def test_a_fit_that_came_to_nothing(changes):
    text = page.html(degenerate(**changes))
    assert Reader(text).unmatched == []
    assert re.search(r"\b(nan|inf|None)\b", words(text)) is None
    for part in ("Interrupted by the user", "not determined", "at its bound", "before its first iteration"):
        assert part in words(text)
    assert "status done" not in text
    assert Reader(report.fragment(degenerate(**changes))).unmatched == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("losses", [[1.0], [0.0, 0.0], [-1e-9], [1.0, NAN, np.inf], [1e-30, 1e30], [2.0, 1.9]])
def test_any_loss_can_be_drawn(losses):
    steps = tuple(Step(i, x, {"ball.m": np.array([0.1 * i])}, 0.1, "lm") for i, x in enumerate(losses))
    text = page.html(degenerate(history=steps, parameters={"ball.m": number(0.3, 0.1, 0.0, "slope")}))
    assert Reader(text).unmatched == []
    assert ("logarithmic" in words(text)) == any(x > 0 for x in losses)


def test_pictures_with_holes_are_drawn():
    seen = view()
    seen.target[:3] = [NAN, np.inf, -1]  # outside the ball
    with np.errstate(all="raise"):
        shown, _ = pictures.show([seen], 1024)
    assert (decode(shown[0].target)[0] == [0, 0, 0]).all()
    nothing = dataclasses.replace(view(), used=np.zeros((96, 96), bool))
    pictures.show([nothing], 1024)
    pictures.show([dataclasses.replace(view(), target=np.zeros((96, 96, 3), np.float32))], 1024)


HOSTILE = """<script>alert("x")</script>'"><img src=x onerror=y>$\\frac{1$&amp;"""


@pytest.mark.parametrize("make", [page.html, report.fragment])
def test_nothing_in_a_name_gets_out(make):
    fit = solution()
    bad = f"ball.{HOSTILE}"
    parameters = {bad: dataclasses.replace(fit.parameters["ball.m"], meaning=HOSTILE, unit=HOSTILE), **fit.parameters}
    steps = tuple(
        dataclasses.replace(s, values={**s.values, bad: s.values["ball.m"]}, stage=f"{HOSTILE}{i % 2}")
        for i, s in enumerate(fit.history)
    )
    plain_tags = [(tag, sorted(a)) for tag, a in Reader(make(fit)).tags if tag in ("script", "img")]
    text = make(
        dataclasses.replace(
            fit,
            parameters=parameters,
            history=steps,
            status=HOSTILE,
            remarks=(HOSTILE,),
            components=(HOSTILE, *fit.components[1:]),
            views=(dataclasses.replace(fit.views[0], sensor=HOSTILE, path=HOSTILE),),
            lobes={HOSTILE: fit.lobes["ball"]},
            checks={HOSTILE: fit.checks["ball"]},
            settings={HOSTILE: HOSTILE, "command": ["brdf", "fit", HOSTILE], "list": [{"a": HOSTILE}]},
            versions={HOSTILE: HOSTILE},
        )
    )
    assert [(tag, sorted(a)) for tag, a in Reader(text).tags if tag in ("script", "img")] == plain_tags
    assert Reader(text).unmatched == []
    assert "".join(HOSTILE.split()) in "".join(Reader(text).text.split())


def srgb(x):
    """IEC 61966-2-1, clipped, as 8 bit."""
    x = np.clip(x, 0, 1)
    return np.round(255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055))


def test_target_and_render_share_one_exposure():
    seen = view()
    shown = pictures.show([seen], 1024)[0][0]
    brightest = seen.target.max(axis=-1)[seen.used]
    assert np.mean(brightest <= shown.white) == pytest.approx(0.99, abs=2e-3)
    for uri, linear in ((shown.target, seen.target), (shown.render, seen.render)):
        assert np.abs(decode(uri) - srgb(linear / shown.white)).max() <= 1
    assert f"the value {shown.white:.3g} is white" in words(page.html(dataclasses.replace(solution(), views=(seen,))))


def test_the_error_has_a_sign_and_ends_at_its_limit():
    target = np.full((20, 20, 3), 0.5, np.float32)
    render = target.copy()
    render[:10] *= 1.1
    render[10:18] *= 0.9
    used = np.ones((20, 20), bool)
    used[:, :4] = False
    shown, limit = pictures.show([View("a", "b", target, render, used, 0.1)], 1024)
    assert limit == pytest.approx(0.1) or limit == pytest.approx(0.2)  # float32 may lift 10 % just above itself
    colours = decode(shown[0].error)
    red, blue = colours[..., 0], colours[..., 2]
    assert (red > blue + 50)[:10, 4:].all()
    assert (blue > red + 50)[10:18, 4:].all()
    assert (colours[18:, 4:] >= 240).all()
    assert np.ptp(colours[:, :4], axis=-1).max() == 0  # grey
    assert len(np.unique(colours[:, :4])) == 2  # hatched


def test_in_the_dark_the_error_is_relative_to_a_part_of_white():
    target = np.full((10, 10, 3), 1.0, np.float32)
    target[0] = 0
    seen = View("a", "b", target, target + np.float32(0.01), np.ones((10, 10), bool), 0.1)
    error = pictures.relative_error(seen, 1.0)
    np.testing.assert_allclose(error[0], 0.01 / 0.05, rtol=1e-5)
    np.testing.assert_allclose(error[1:], 0.01, rtol=1e-5)


@pytest.mark.parametrize(
    ("x", "expected"), [(0.1, 0.1), (0.11, 0.2), (0.0021, 0.005), (0.7, 1), (2, 2), (0, 1e-6), (99, 100)]
)
def test_round_numbers(x, expected):
    assert pictures.round_up(x) == expected


def test_a_large_picture_is_shrunk_to_its_means():
    seen = view(size=1100)
    shown = pictures.show([seen], 1024)[0][0]
    assert shown.shrink == 2 and decode(shown.target).shape == (550, 550, 3)
    mean = seen.target.reshape(550, 2, 550, 2, 3).mean(axis=(1, 3))
    assert np.abs(decode(shown.target) - srgb(mean / shown.white)).max() <= 1
    assert "1100 × 1100 pixels, shown at 1/2 of the size" in words(
        page.html(dataclasses.replace(solution(), views=(seen,)))
    )


def test_bars_are_on_one_scale():
    tables, limit = page.parameter_tables(solution(), {"ball"})
    m, eta, diffuse = tables["ball"]
    assert limit == 0.02  # blue: 1.97 * 0.001 / 0.1, the widest, rounded up
    for got, value, sd in ((m.lines[0].bar, 0.30012, 0.00041), (eta.lines[0].bar, 1.5031, 0.0052)):
        assert got is not None
        assert got.high - 50 == pytest.approx(50 * 1.97 * sd / value / 0.02)
        assert 50 - got.low == pytest.approx(got.high - 50)
        assert not got.left and not got.right
    assert diffuse.lines[2].bar is not None and diffuse.lines[2].bar.high == pytest.approx(50 + 50 * 0.0197 / 0.02)
    wide = {"a.x": number(0.1, 3.0, 0.1, ""), "a.zero": number(0.0, 0.1, 0.1, ""), "a.none": number(1.0, NAN, 1.0, "")}
    tables, limit = page.parameter_tables(degenerate(parameters=wide), set())
    bars = [row.lines[0].bar for row in tables["a"]]
    assert limit == 1
    assert bars == [page.Bar(0, 100, True, True), page.Bar(0, 100, True, True), None]


@pytest.mark.parametrize(
    ("value", "sd", "expected"),
    [
        (0.300124, 0.00041, ("0.30012", "0.00041")),
        (1.5, 0.25, ("1.50", "0.25")),
        (1234.5, 38.0, ("1234", "38")),
        (0.3, 1e-12, ("0.30000000", "1.0e−12")),
        (0.3, 0.0, ("0.30000", "0.00000")),
        (-0.5, 0.1, ("−0.50", "0.10")),
    ],
)
def test_digits(value, sd, expected):
    got = page.line(number(value, sd, 0.1, ""), 0, "", 1.0)
    assert (got.value, got.sd) == expected


def test_parameters_are_listed_by_material_whatever_dots_their_names_have():
    some = number(0.3, 0.1, 0.2, "")
    parameters = {"shape[2].bsdf.alpha": some, "ball.eta.value": some, "floor.m": some}
    tables, _ = page.parameter_tables(degenerate(parameters=parameters), {"ball", "shape[2].bsdf"})
    assert {k: [row.name for row in rows] for k, rows in tables.items()} == {
        "shape[2].bsdf": ["alpha"],
        "ball": ["eta.value"],
        "floor": ["m"],
    }


def contrast(a, b):
    """WCAG 2's ratio of two colours #rrggbb."""
    ys = []
    for colour_ in (a, b):
        if len(colour_) == 4:
            colour_ = "#" + "".join(2 * c for c in colour_[1:])
        c = np.array([int(colour_[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        ys.append(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722])
    return (max(ys) + 0.05) / (min(ys) + 0.05)


def test_figures_of_the_correlation_can_be_read():
    for c in np.linspace(-1, 1, 201):
        _, paper, ink = page.correlation_cell(float(c))
        assert contrast(paper, ink) >= 4.5, c


def test_text_and_lines_stand_out_in_light_and_dark():
    css = page.ENVIRONMENT.get_template("page.css").render()
    blocks = re.findall(r":root \{(.*?)\}", css, re.S)
    assert len(blocks) == 2
    for block in blocks:
        colours = dict(re.findall(r"--([\w-]+): (#\w{6})", block))
        assert len(colours) == 21
        for ink, paper in (
            ("ink", "paper"),
            ("ink", "panel"),
            ("soft", "paper"),
            ("soft", "panel"),
            ("ink", "warn-paper"),
        ):
            assert contrast(colours[ink], colours[paper]) >= 4.5, (ink, paper)
        for name in ("good", "warn", "bad"):
            assert contrast(colours[name], colours[f"{name}-paper"]) >= 4.5, name
        for name in [f"series-{i}" for i in range(8)] + ["faint", "accent"]:
            assert contrast(colours[name], colours["paper"]) >= 3, name


def test_swatches():
    assert page.swatch(np.array([1.0, 0.0, 0.2158605])) == "#ff0080"
    assert page.swatch(np.array([4.0, 0.0, 4 * 0.2158605])) == "#ff0080"
    assert page.swatch(np.array([NAN, -1.0, 0.0])) == "#000000"


def test_plots_take_their_colours_from_the_page():
    text = page.html(solution())
    svg = "".join(re.findall(r"<svg aria-hidden.*?</svg>", text, re.S))
    assert "var(--series-0)" in svg and "var(--ink)" in svg
    stray = set(re.findall(r"#[0-9a-f]{6}\b", svg)) - {"#000000", "#ffffff"}
    assert not {c for c in stray if c.startswith(("#a0", "#b0"))}
    assert "<text" in svg and "DejaVu" not in svg


def test_stages():
    steps = solution().history
    assert plots.stages_of(steps) == [(0, 1, "grid of starts"), (1, 8, "Levenberg-Marquardt"), (8, 12, "more samples")]
    assert plots.iterations(steps).tolist() == list(range(12))
    again = (*steps[:3], *steps[:3])
    assert plots.iterations(again).tolist() == list(range(6))


def test_the_fragment_styles_only_itself():
    text = report.fragment(solution(2, 2))
    assert text.lstrip().startswith('<div class="brdf-solution">')
    assert Reader(text).unmatched == []
    css = "".join(re.findall(r"<style>(.*?)</style>", text, re.S))
    selectors = [s.strip() for rule in re.findall(r"([^{}]+)\{", css) for s in rule.split(",")]
    assert selectors and all(s.startswith(".brdf-solution") for s in selectors)
    for part in (
        "Converged after 12",
        "ball.m",
        "floor.diffuse_reflectance.g",
        "0.30012 ± 0.00041",
        "hard to tell apart",
    ):
        assert part in words(text)
    assert len(Reader(text).all("img")) == 8
    assert solution()._repr_html_() == report.fragment(solution())


def test_it_is_written(tmp_path):
    report.write(solution(), tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page.html(solution())
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(DataError, match=re.escape(str(tmp_path / "no"))):
        report.write(solution(), tmp_path / "no" / "report.html")


def test_the_users_matplotlib_is_left_alone():
    before = dict(matplotlib.rcParams)
    page.html(solution())
    assert dict(matplotlib.rcParams) == before
