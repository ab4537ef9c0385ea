"""What `tools.deploy` puts in its place and takes away again; systemd's part is rehearsed."""

import shutil
from pathlib import Path

import pytest

from tools import pages
from tools.deploy import __main__ as deploy
from tools.deploy import rehearsal

FILES = ("UNIT", "RULES")
FOLDERS = ("PREFIX", "SETTINGS", "DROP_INS", "STATE", "CACHE", "RUNTIME")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every place that deploy knows, filled, below `tmp_path`; no command is run."""
    for name in (*FILES, *FOLDERS, "COMMAND"):
        place = tmp_path / str(getattr(deploy, name)).lstrip("/")
        monkeypatch.setattr(deploy, name, place)
        place.parent.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        getattr(deploy, name).write_text("x")
    for name in FOLDERS:
        getattr(deploy, name).mkdir()
        (getattr(deploy, name) / "something").write_text("x")
    deploy.link(deploy.COMMAND, deploy.PREFIX / "bin" / "autonomy")
    monkeypatch.setattr(deploy, "run", lambda *_, **__: None)
    monkeypatch.setattr(deploy, "systemd_runs", lambda: False)
    monkeypatch.setattr(deploy, "has_user", lambda: False)
    return tmp_path


def left(root: Path) -> set[str]:
    """Every file below `root`."""
    return {str(path.relative_to(root)) for path in root.rglob("*") if not path.is_dir()}


def test_remove_keeps_configuration_and_logs_and_nothing_else(root: Path) -> None:
    deploy.remove(purge=False)
    assert left(root) == {
        "etc/autonomy/something",
        "etc/systemd/system/autonomy.service.d/something",
        "run/autonomy/something",
        "var/lib/autonomy/something",
    }


def test_purge_leaves_nothing(root: Path) -> None:
    deploy.remove(purge=True)
    assert left(root) == set()


def test_what_cannot_be_removed_is_told_and_the_rest_goes(root: Path) -> None:
    shutil.rmtree(deploy.CACHE)
    deploy.CACHE.symlink_to(root)  # a folder elsewhere is not followed
    with pytest.raises(deploy.DeployError, match=f"not removed: {deploy.CACHE} .*link"):
        deploy.remove(purge=True)
    assert left(root) == set()
    assert deploy.CACHE.is_symlink()


def test_a_foreign_command_of_that_name_is_left_alone(root: Path) -> None:
    deploy.COMMAND.unlink()
    deploy.COMMAND.write_text("another's")
    with pytest.raises(deploy.DeployError, match="is another program"):
        deploy.install(str(root))
    deploy.remove(purge=True)
    assert deploy.COMMAND.read_text() == "another's"


def test_a_running_service_is_not_replaced_under_way(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = left(root)
    monkeypatch.setattr(deploy, "is_active", lambda: True)
    with pytest.raises(deploy.DeployError, match="systemctl stop autonomy"):
        deploy.install(str(root))
    assert left(root) == before


def test_what_a_build_left_behind_is_not_built_again(tmp_path: Path) -> None:
    source = tmp_path / "source"
    for name in ("autonomy", "build/lib/autonomy", ".git", "autonomy.egg-info"):
        (source / name).mkdir(parents=True)
        (source / name / "module.py").write_text("x")
    shutil.copytree(source, tmp_path / "copy", ignore=deploy.NOT_SOURCE)
    assert left(tmp_path / "copy") == {"autonomy/module.py"}


def test_the_token_is_long_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "chown", lambda *_: None)
    path = tmp_path / "token"
    deploy.make_token(path)
    token = path.read_text()
    assert len(token.strip()) >= 40
    assert path.stat().st_mode & 0o007 == 0
    deploy.make_token(path)
    assert path.read_text() == token


def test_the_page_names_every_place() -> None:
    page = rehearsal.README.read_text(encoding="utf-8")
    for name in (*FILES, *FOLDERS):
        assert str(getattr(deploy, name)) in page
    pages.must_have(rehearsal.SECTION, rehearsal.README)


def test_a_rehearsal_is_refused_where_nothing_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rehearsal, "PROGRAM", str(tmp_path / "autonomy"))
    assert rehearsal.main([]) == 2
    assert capsys.readouterr().err.startswith("rehearsal: ")


def test_an_unexpected_outcome_is_told_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails() -> str:
        """This is done."""
        raise rehearsal.Unexpected("it did not")

    def works() -> str:
        """That is done."""
        return "as promised"

    for name in ("configure", "clear", "run"):
        monkeypatch.setattr(rehearsal, name, lambda *_, **__: None)
    monkeypatch.setattr(rehearsal, "DROP_IN", tmp_path / "drop-in")
    monkeypatch.setattr(rehearsal, "CONFIGURATION", str(tmp_path / "configuration"))
    monkeypatch.setattr(rehearsal, "CASES", {"fails": fails, "works": works})
    rows, failed = rehearsal.rehearsed(["fails", "works"])
    assert failed
    assert rows == [("This is done", "UNEXPECTED: it did not"), ("That is done", "as promised")]
