"""Files that are there whole or not at all, and that their group may read if the umask lets it."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a new empty file beside `path` to be written; on leaving, it takes the place of `path`.

    Readers see the old content or the new, never a part. After an error the old file is left as
    it was. Raises OSError when the folder cannot be written.
    """
    # In the same folder, so that the rename cannot cross file systems; with a random name, so
    # that two writers do not meet. tempfile would keep everyone but the owner from reading.
    temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            _name(error, temporary, path)
        raise


def write_text(path: Path, text: str) -> None:
    """Replace `path` by a text in UTF-8; raises OSError naming it when it cannot be written."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _name(error: OSError, temporary: Path, path: Path) -> None:
    """Have an error name `path`: a full disk names no file, and a temporary one means nothing."""
    # Libraries raise errors without a number, whose words a name would take the place of.
    if error.errno is not None and error.filename in (None, str(temporary), temporary):
        error.filename = str(path)
