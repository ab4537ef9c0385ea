"""A start where nothing may be written still starts; what is compiled is kept where it can be."""

from pathlib import Path

import pytest

from autonomy import warm
from autonomy.kernel_cache import VARIABLE, ensure_place, is_temporary


@pytest.fixture
def locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that may not be written, also when the tests are root's."""
    folder = tmp_path / "locked"
    folder.mkdir()
    monkeypatch.setattr(
        "autonomy.kernel_cache.os.access",
        lambda path, _: not Path(path).is_relative_to(folder),
    )
    return folder


def test_a_writable_package_keeps_its_kernels(tmp_path: Path) -> None:
    environ = {"HOME": "/nonexistent"}
    ensure_place(environ, tmp_path)
    assert environ == {"HOME": "/nonexistent"}


def test_the_user_s_cache_folder_is_enough(locked: Path, tmp_path: Path) -> None:
    for environ in ({"HOME": str(tmp_path)}, {"HOME": "", "XDG_CACHE_HOME": str(tmp_path / "c")}):
        before = dict(environ)
        ensure_place(environ, locked)
        assert environ == before
        assert not is_temporary(environ)


@pytest.mark.parametrize("home", ["locked", None])
def test_where_nothing_may_be_written_a_private_folder_is_made(
    locked: Path, home: str | None
) -> None:
    environ = {} if home is None else {"HOME": str(locked)}
    ensure_place(environ, locked)
    assert is_temporary(environ)
    assert Path(environ[VARIABLE]).stat().st_mode & 0o077 == 0


def test_a_named_folder_counts_alone(locked: Path, tmp_path: Path) -> None:
    environ = {VARIABLE: str(tmp_path / "new"), "HOME": str(locked)}
    ensure_place(environ, locked)
    assert environ[VARIABLE] == str(tmp_path / "new")
    environ = {VARIABLE: str(locked / "new"), "HOME": str(tmp_path)}
    ensure_place(environ, tmp_path)
    assert is_temporary(environ)


def test_warming_up_a_second_time_has_nothing_to_say() -> None:
    said: list[str] = []
    warm.warm_up()
    warm.warm_up(said.append)
    assert said == []
