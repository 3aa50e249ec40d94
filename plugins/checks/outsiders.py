"""The checks as tests of somebody else's package."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

from brdf import Model
from brdf.checks.gather import selected
from brdf.checks.result import CHECKS, Result

from .gather import RENDERS, check


class CheckFailed(AssertionError):
    """A check did not come out as declared; the text says what was found and where."""


class Case:
    """One check of one BSDF, to be called.

    Attributes
    ----------
    name : str
        ``MODEL-CHECK``.
    declared : str
        Why it is expected to fail; empty if it is not.
    """

    def __init__(self, name: str, declared: str, run: Callable[[], Result]) -> None:
        self.name, self.declared, self.run = name, declared, run

    def __repr__(self) -> str:
        return self.name

    def __call__(self) -> Result:
        """Run the check.

        Raises
        ------
        CheckFailed
            It failed; also if that is declared: pytest then counts an expected failure.
        """
        result = self.run()
        if not result.passed:
            raise CheckFailed(f"{self.name}: {result.reason} {dict(result.case)}")
        return result


def cases(
    *what: Model | type[Model] | str | Mapping[str, Any], only: Collection[str] | None = None, seed: int = 0
) -> list[Case]:
    """Every check of some models, or of anything that `check` takes, each to be called."""
    found = []
    for item in what:
        instance = item() if isinstance(item, type) else item
        faults = instance.faults() if isinstance(instance, Model) else {}
        if isinstance(instance, Model):
            title = "-".join([instance.name, *(str(v) for v in vars(instance).values())])
        else:
            title = instance if isinstance(instance, str) else str(instance["type"])
        for name in selected(only, CHECKS):
            found.append(Case(f"{title}-{name}", faults.get(name, ""), partial(only_one, item, name, seed)))
    return found


def only_one(item: Any, name: str, seed: int) -> Result:
    """One check by its name."""
    return check(item, only=[name], seed=seed)[name]


def parametrize(
    *what: Model | type[Model] | str | Mapping[str, Any],
    only: Collection[str] | None = None,
    renders: bool = True,
    seed: int = 0,
) -> Any:
    """A pytest decorator that calls a test with each check of each model, as an argument ``check``.

    In a test file of your own package, this is all::

        import mitsuba as mi
        from plugins.checks import parametrize
        from mypackage import MyModel

        mi.set_variant("llvm_ad_rgb")

        @parametrize(MyModel, MyModel(variant="other"))
        def test_my_model(check):
            check()

    A check that the model declares to fail (`Model.faults`) is an expected failure, with the declared reason; that it
    passes is then a failure.

    Parameters
    ----------
    what : models, classes of models, or anything that `check` takes
    only : names of checks
        All if left out.
    renders : bool
        Whether to make the checks that render, which take half a minute each.
    seed : int
    """
    import pytest  # of those who test; not needed to run anything

    wanted = [name for name in selected(only, CHECKS) if renders or name not in RENDERS]
    marked = [
        pytest.param(
            case,
            id=case.name,
            marks=[pytest.mark.xfail(raises=CheckFailed, strict=True, reason=case.declared)] if case.declared else [],
        )
        for case in cases(*what, only=wanted, seed=seed)
    ]
    return pytest.mark.parametrize("check", marked)
