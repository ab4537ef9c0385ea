"""Where compiled kernels are kept. numba refuses to load a kernel that it could not keep."""

import atexit
import os
import shutil
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
_PREFIX = "autonomy-kernels-"
_PACKAGE = Path(__file__).resolve().parent


def ensure_place(environ: MutableMapping[str, str], package: Path = _PACKAGE) -> None:
    """Name a private temporary folder where nothing else may be written.

    numba looks, in this order, for: the folder in NUMBA_CACHE_DIR (the only one where it is set),
    `__pycache__` beside the source, `numba` in the user's cache folder. Must be called before any
    kernel is imported. The temporary folder ends with the process, so that the next start compiles
    again; it is private because numba runs what it finds there.
    """
    named = environ.get(VARIABLE)
    home = Path(environ.get("HOME") or os.devnull)
    user = Path(environ.get("XDG_CACHE_HOME") or home / ".cache") / "numba"
    places = [Path(named)] if named else [package / "perception" / "__pycache__", user]
    if any(_may_write(place) for place in places):
        return
    folder = tempfile.mkdtemp(prefix=_PREFIX)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    environ[VARIABLE] = folder


def is_temporary(environ: MutableMapping[str, str]) -> bool:
    """True when what is compiled now is compiled again at the next start."""
    return Path(environ.get(VARIABLE, "")).name.startswith(_PREFIX)


def _may_write(folder: Path) -> bool:
    """True when files can be made in `folder`, which need not exist yet."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
