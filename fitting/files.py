"""Writing a file so that it is there whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from brdf.errors import DataError


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary file beside `path`, with the same ending; renamed to `path` at the end, removed after an error.

    Raises
    ------
    DataError
        The folder is missing or cannot be written, or the disk is full.
    """
    path = Path(path)
    folder = path.parent
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "there is no such folder"
        raise DataError(f"{folder}: {what}, {path.name} cannot be written there. Make it, or name another.")
    temporary = folder / f".{path.stem}.{secrets.token_hex(4)}{path.suffix}"
    try:
        # An ordinary open, for the permissions that the user's umask asks for.
        temporary.open("xb").close()
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise DataError(f"{folder}: {path.name} cannot be written there: {error.strerror or error}.") from error
    finally:
        temporary.unlink(missing_ok=True)
