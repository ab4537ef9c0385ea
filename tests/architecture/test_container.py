"""The recipe of the image: clean to its linter, and made of what the project has."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

from autonomy.service.commands import DEFAULT_URL
from hal.config import VehicleConfig

ROOT = Path(__file__).parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def instructions(name: str) -> list[str]:
    """What follows each instruction of a name, continued lines joined."""
    joined = DOCKERFILE.replace("\\\n", " ")
    return re.findall(rf"^{name} +(.*)$", joined, re.MULTILINE)


def test_the_linter_finds_nothing() -> None:
    linter = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    assert linter is not None, "pip install 'autonomy[release]' brings hadolint"
    done = subprocess.run(
        [linter, "--failure-threshold", "style", str(ROOT / "Dockerfile")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "")


def test_what_is_copied_is_there_and_let_through() -> None:
    let_through = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    copied = [words.split()[:-1] for words in instructions("COPY") if "--from" not in words]
    for source in (each for sources in copied for each in sources):
        assert (ROOT / source).exists(), source
        assert f"!{source}" in let_through, source


def test_it_is_not_root_s_and_serves_by_default() -> None:
    assert instructions("USER")[-1] == "1000"
    assert json.loads(instructions("ENTRYPOINT")[-1]) == ["autonomy"]
    assert json.loads(instructions("CMD")[-1]) == ["serve"]


def test_health_is_asked_where_the_service_listens() -> None:
    (environment,) = instructions("ENV")
    assert f"AUTONOMY_URL={DEFAULT_URL} " in environment
    (health,) = instructions("HEALTHCHECK")
    asked = json.loads(health.partition("CMD ")[2])
    assert asked[:2] == ["python", "-c"]
    compile(asked[2], "HEALTHCHECK", "exec")
    assert "AUTONOMY_URL" in asked[2]


def test_the_ports_are_the_defaults() -> None:
    mavlink = re.search(r":(\d+)$", VehicleConfig().connection)
    assert mavlink is not None
    http = DEFAULT_URL.rpartition(":")[2]
    assert instructions("EXPOSE") == [f"{http}/tcp {mavlink[1]}/udp"]
