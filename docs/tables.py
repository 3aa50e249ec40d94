"""Write what the models declare into docs/models.md and the README: ``.venv/bin/python docs/tables.py``."""

from __future__ import annotations

import argparse
import inspect
import re
from pathlib import Path

from brdf import Model, Param, builtin
from fitting.cli.models import consequences, default_text

HERE = Path(__file__).parent
README = HERE.parent / "README.md"
#: The README's table stands between these.
BEGIN, END = "<!-- models: docs/tables.py -->\n", "<!-- end of models -->\n"

HEAD = """# The models

What each model declares, as `brdf models NAME` prints it too. `.venv/bin/python docs/tables.py` writes this page.

In XML every number and colour may be a texture; all are differentiable through `mi.traverse`. A number `eta` may also
be given as `int_ior` and `ext_ior`, each a number or a medium that Mitsuba knows (`bk7`, `water`, `air`; air,
1.000277, is what lies outside if it is left out), and `eta` and `k` as `material`, one of Mitsuba's measured metals
(`Al`, `Au`, `Cu`, ...). A choice that is left out follows from the parameters that are given, else it is the first.

A fit moves a parameter in the coordinate of its scale: itself, its logarithm, log(x - 1), or, between two ends, the
logit.

A *declared fault* is a check that the model is known to fail, and why: see `brdf check`.
"""


def page() -> str:
    """The text of docs/models.md."""
    return "\n".join([HEAD, *(section(model) for model in builtin().values())])


def section(model: type[Model]) -> str:
    """What one model declares."""
    lobes = ", ".join(lobe.value for lobe in model.lobes)
    sources = ", ".join(f"`{key}`" for key in model.source)
    lines = [
        f"## `{model.name}`",
        "",
        f"{model.summary[0].upper()}{model.summary[1:]}. {formula(model)}",
        "",
        f"Lobes: {lobes}. Source: {sources} of [references.bib](../brdf/references.bib).",
        "",
        "| parameter | kind | default | allowed | unit | a fit moves | meaning |",
        "|---|---|---|---|---|---|---|",
        *(row(p) for p in model.params),
        "",
    ]
    for made, changed in consequences(model).items():
        lines.append(f"- With {made}: {'; '.join(f'`{name}`: {what}' for name, what in changed.items())}.")
    for check, reason in faults(model).items():
        lines.append(f"- Declared fault, {check}: {reason}")
    return "\n".join([*lines, ""]).replace("\n\n\n", "\n\n")


def formula(model: type[Model]) -> str:
    """The first line of a model's docstring, which is its formula, as Markdown."""
    return (inspect.getdoc(model) or "").split("\n\n")[0].replace("\n", " ").replace("``", "`")


def row(p: Param) -> str:
    """A line of a parameter table."""
    choice = p.kind == "choice"
    allowed = ", ".join(p.options) if choice else p.range_text()
    unit, scale = ("", "") if choice else (p.unit, p.scale)
    return f"| `{p.name}` | {p.kind} | {default_text(p)} | {allowed} | {unit} | {scale} | {p.meaning} |"


def faults(model: type[Model]) -> dict[str, str]:
    """Declared faults, of the default choices and of each other option, which is then named."""
    usual = model().faults()
    found = {f"`{check}`": sentence(reason) for check, reason in usual.items()}
    for choice in (p for p in model.params if p.kind == "choice"):
        for option in choice.options[1:]:
            for check, reason in model(**{choice.name: option}).faults().items():
                if usual.get(check) != reason:
                    found[f"`{check}` with {choice.name} = {option}"] = sentence(reason)
    return found


def sentence(text: str) -> str:
    """With a full stop."""
    return text if text.endswith(".") else f"{text}."


def overview() -> str:
    """The table of the README."""
    lines = ["| type | what it is | parameters |", "|---|---|---|"]
    for model in builtin().values():
        names = ", ".join(f"`{p.name}`" for p in model.params)
        lines.append(f"| [`{model.name}`](docs/models.md#{model.name}) | {model.summary} | {names} |")
    return "\n".join(lines) + "\n"


def in_readme(text: str) -> str:
    """The README with its table as it should be."""
    pattern = re.escape(BEGIN) + ".*?" + re.escape(END)
    return re.sub(pattern, lambda _: BEGIN + overview() + END, text, flags=re.DOTALL)


def main() -> None:
    """Write both."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    (HERE / "models.md").write_text(page(), encoding="utf-8")
    README.write_text(in_readme(README.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
