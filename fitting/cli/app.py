"""The command ``brdf``: its verbs, and how each kind of failure ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

import typer

from brdf.errors import BrdfError, DataError, UsageError

from . import check, doctor, example, fit, models, plan, render

INTERRUPTED = 130

app = typer.Typer(
    help="Fit the parameters of a reflection model to pictures, in Mitsuba scenes.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 done; 1 done, but not converged or a check failed; 2 wrong use; 3 bad data; 4 no backend; "
    "130 interrupted.",
)
# What a verb needs is imported when it runs, so that help comes at once.
app.command("fit")(fit.command)
app.command("example")(example.command)
app.command("render")(render.command)
app.command("plan")(plan.command)
app.command("models")(models.command)
app.command("check")(check.command)
app.command("doctor")(doctor.command)


def show_version(wanted: bool) -> None:
    """Print the version and end."""
    if wanted:
        try:
            print(f"brdf {version('brdf-fitting')}")
        except PackageNotFoundError:
            print("brdf, not installed")
        raise typer.Exit


@app.callback()
def options(
    _: Annotated[
        bool, typer.Option("--version", callback=show_version, is_eager=True, help="Show the version and end.")
    ] = False,
) -> None:
    """What holds for all verbs."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str
        Without the program's name; default: those of this process.

    Returns
    -------
    int
        The exit code. A failure that is ours to explain is one line on standard error, without a traceback.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = app(args=given or ["--help"], prog_name="brdf", standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output has gone, as head does; nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except BrdfError as error:
        return fail(str(error), error.exit_code)
    except typer.TyperException as error:
        return fail(f"{error.format_message().rstrip('.')}. See: {usage(error)}", UsageError.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:
        what = error.strerror or str(error)
        return fail(f"{error.filename}: {what}" if error.filename else what, DataError.exit_code)
    if code == INTERRUPTED:
        return fail("interrupted", INTERRUPTED)
    return code if isinstance(code, int) else 0


def usage(error: typer.TyperException) -> str:
    """The help that fits what was typed."""
    context = getattr(error, "ctx", None)
    return f"{context.command_path if context else 'brdf'} --help"


def fail(message: str, code: int) -> int:
    """Say in one line why, and return `code`."""
    print(f"brdf: {' '.join(message.split())}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
