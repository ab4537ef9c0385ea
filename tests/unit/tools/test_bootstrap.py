"""The environment is made from whatever index pip is configured for, and nothing unchecked."""

import functools
import hashlib
import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.bootstrap import (
    BootstrapError,
    download,
    fetch_pip,
    main,
    newest_pip,
    pip_settings,
)

BODY = b"a wheel"
DIGEST = hashlib.sha256(BODY).hexdigest()


def anchor(name: str, fragment: str = f"sha256={DIGEST}", attributes: str = "") -> str:
    return f'<a href="../../files/{name}#{fragment}" {attributes}>{name}</a>\n'


PAGE = "".join(
    [
        anchor("pip-9.0.1.tar.gz"),
        anchor("pip-9.0.1-py2.py3-none-any.whl"),
        anchor("pip-23.1-py3-none-any.whl"),
        anchor("pip-23.2.1-py3-none-any.whl"),
        anchor("pip-23.10-py3-none-any.whl", attributes='data-requires-python="&gt;=3.7"'),
        anchor("pip-24.0-py3-none-any.whl", attributes='data-requires-python="&gt;=3.12"'),
        anchor("pip-25.0b1-py3-none-any.whl"),
        anchor("pip-26.0-py3-none-any.whl", attributes='data-yanked="broken"'),
        anchor("pip-27.0-py3-none-any.whl", fragment="md5=0123"),
    ]
)


def test_the_newest_final_checked_release_for_this_python_is_taken() -> None:
    wheel = newest_pip(PAGE, "https://index.example/simple/pip/", (3, 11))
    assert wheel.name == "pip-23.10-py3-none-any.whl"
    assert wheel.url == "https://index.example/files/pip-23.10-py3-none-any.whl"
    assert wheel.sha256 == DIGEST


def test_an_index_without_pip_is_told() -> None:
    with pytest.raises(BootstrapError, match="offers no wheel of pip"):
        newest_pip("<html></html>", "https://index.example/simple/pip/", (3, 11))


def test_pip_is_configured_as_pip_reads_it(tmp_path: Path) -> None:
    system, user, named = (tmp_path / name for name in ("system", "user", "named"))
    system.write_text("[global]\nindex-url = https://one/simple\ncert = /one.pem\n")
    user.write_text("[install]\nindex-url = https://two/simple\n")
    named.write_text("[global]\nindex-url = https://three/simple\n")
    files = (system, user, tmp_path / "absent")
    assert pip_settings({}, files) == {"index-url": "https://two/simple", "cert": "/one.pem"}
    environ = {"PIP_CONFIG_FILE": str(named)}
    assert pip_settings(environ, files)["index-url"] == "https://three/simple"
    environ["PIP_INDEX_URL"] = "https://four/simple"
    assert pip_settings(environ, files)["index-url"] == "https://four/simple"
    assert pip_settings({"PIP_CONFIG_FILE": "/dev/null"}, files) == {}
    system.write_text("not an ini file")
    with pytest.raises(BootstrapError, match="is not a pip configuration file"):
        pip_settings({}, files)


class Index(http.server.SimpleHTTPRequestHandler):
    """A package index that wants a password."""

    def do_GET(self) -> None:
        if self.headers.get("Authorization") != "Basic bWU6c2VjcmV0":  # me:secret
            self.send_error(401)
            return
        super().do_GET()

    def log_message(self, *arguments: object) -> None:
        """Quiet."""


@pytest.fixture
def index(tmp_path: Path) -> Iterator[str]:
    page = tmp_path / "simple" / "pip" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text(PAGE)
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "pip-23.10-py3-none-any.whl").write_bytes(BODY)
    handler = functools.partial(Index, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://me:secret@127.0.0.1:{server.server_port}/simple"
        server.shutdown()
        thread.join()


def test_pip_is_fetched_with_the_indexs_password(index: str, tmp_path: Path) -> None:
    path = fetch_pip(tmp_path, {"index-url": index})
    assert path.name == "pip-23.10-py3-none-any.whl"
    assert path.read_bytes() == BODY


def test_a_wheel_that_is_not_what_the_index_says_is_not_used(index: str, tmp_path: Path) -> None:
    (tmp_path / "files" / "pip-23.10-py3-none-any.whl").write_bytes(b"another wheel")
    with pytest.raises(BootstrapError, match="the SHA-256 differs"):
        fetch_pip(tmp_path, {"index-url": index})


def test_an_index_that_cannot_be_read_is_told_without_its_password(index: str) -> None:
    with pytest.raises(BootstrapError, match="cannot be fetched") as caught:
        download(f"{index}/absent/", None)
    assert "secret" not in str(caught.value)
    with pytest.raises(BootstrapError, match="only http, https and file"):
        download("ftp://index.example/simple/pip/", None)


def test_an_unknown_word_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["everything"]) == 2
    assert "usage" in capsys.readouterr().err


def test_the_script_needs_nothing_but_the_standard_library() -> None:
    source = (Path(__file__).parents[3] / "tools" / "bootstrap.py").read_text(encoding="utf-8")
    imported = {
        line.split()[1].partition(".")[0]
        for line in source.splitlines()
        if line.startswith(("import ", "from "))
    }
    assert imported <= sys.stdlib_module_names
