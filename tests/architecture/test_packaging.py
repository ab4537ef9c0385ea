"""What is installed: every package, every document, in plain and editable installations."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_every_folder_with_python_in_it_is_a_package() -> None:
    for top in ("autonomy", "hal", "tools"):
        for source in (ROOT / top).rglob("*.py"):
            assert (source.parent / "__init__.py").exists(), source


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources alone, where a build may leave its traces."""
    folder = tmp_path_factory.mktemp("checkout")
    ignore = shutil.ignore_patterns("__pycache__")
    for top in ("autonomy", "hal", "configs"):
        shutil.copytree(ROOT / top, folder / top, ignore=ignore, symlinks=True)
    for path in (ROOT / "pyproject.toml", ROOT / "LICENSE", *ROOT.glob("README.md")):
        shutil.copy(path, folder)
    return folder


@pytest.fixture(scope="module", params=["build_wheel", "build_editable"])
def installed(
    request: pytest.FixtureRequest, checkout: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A site folder with the project installed by its own build backend, without a network."""
    out = tmp_path_factory.mktemp("wheel")
    hook = f"from setuptools import build_meta; build_meta.{request.param}({str(out)!r})"
    run = subprocess.run(
        [sys.executable, "-c", hook], cwd=checkout, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    site = tmp_path_factory.mktemp("site")
    (wheel,) = out.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(site)
    return site


def run_installed(site: Path, code: str) -> str:
    """What `code` prints, run in an empty folder with `site` as the only place of the project."""
    setup = f"import site, sys; site.addsitedir({str(site)!r}); "
    isolated = [sys.executable, "-I", "-S", "-c", setup + code]
    run = subprocess.run(isolated, cwd=site, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout.strip()


def test_an_installation_ships_every_scenario(installed: Path) -> None:
    code = (
        "import importlib.resources as r, pathlib; root = r.files('hal.sim') / 'scenarios'; "
        "print(*sorted(p.name for p in pathlib.Path(str(root)).glob('*.yaml')))"
    )
    scenarios = {path.name for path in (ROOT / "configs" / "scenarios").glob("*.yaml")}
    assert set(run_installed(installed, code).split()) == scenarios


def test_an_installation_has_every_package_and_nothing_else(installed: Path) -> None:
    expected = {
        ".".join(init.parent.relative_to(ROOT).parts)
        for top in ("autonomy", "hal")
        for init in (ROOT / top).rglob("__init__.py")
    }
    code = (
        "import pkgutil, importlib.metadata as m, autonomy, hal; "
        "print(*[p.name for top in (autonomy, hal) for p in "
        "pkgutil.walk_packages(top.__path__, top.__name__ + '.') if p.ispkg])"
    )
    assert {"autonomy", "hal", *run_installed(installed, code).split()} == expected
    top_level = next(installed.glob("*.dist-info")) / "top_level.txt"
    assert top_level.read_text().split() == ["autonomy", "hal"]


def test_an_installation_has_the_version_and_the_command_and_the_command(installed: Path) -> None:
    code = (
        "import autonomy, hal, importlib.metadata as m; "
        "print(autonomy.__version__ == m.version('autonomy'), "
        "m.distribution('autonomy').entry_points['autonomy'].value)"
    )
    assert run_installed(installed, code) == "True autonomy.cli:main"


def test_an_installation_has_its_types(installed: Path) -> None:
    code = (
        "import importlib.resources as r; "
        "print(*[(r.files(top) / 'py.typed').is_file() for top in ('autonomy', 'hal')])"
    )
    assert run_installed(installed, code) == "True True"
