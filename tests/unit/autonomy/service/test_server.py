import secrets
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from autonomy.config import Config, ServiceConfig
from autonomy.errors import BadInput
from autonomy.service.api import Api
from autonomy.service.client import Client, NoService
from autonomy.service.contract import Phase
from autonomy.service.gate import Access
from autonomy.service.metrics import Metrics
from autonomy.service.server import WebServer, access_of, is_loopback, listening_socket, url_of
from autonomy.service.station import Station
from autonomy.service.workshop import Workshop
from hal.errors import PortInUse

TOKEN = "x" * 20


def accept(_: object) -> None:
    """Anything may be flown."""


@pytest.mark.parametrize("host", ["10.0.0.7", "192.168.1.5", "::", "drone.local"])
def test_beyond_loopback_a_token_is_demanded(host: str) -> None:
    with pytest.raises(BadInput, match="needs a token"):
        access_of(ServiceConfig(host=host), {})
    assert access_of(ServiceConfig(host=host), {"AUTONOMY_TOKEN": TOKEN}).token == TOKEN


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.8.8.8"])
def test_loopback_needs_none(host: str) -> None:
    assert is_loopback(host)
    assert access_of(ServiceConfig(host=host), {}).token is None


def test_a_token_s_file_is_read_and_a_useless_one_refused(tmp_path: Path) -> None:
    path = tmp_path / "token"
    config = ServiceConfig(host="192.168.1.5", token_file=str(path))
    with pytest.raises(BadInput, match="cannot be read"):
        access_of(config, {})
    path.write_text("\n")
    with pytest.raises(BadInput, match="holds no token"):
        access_of(config, {})
    path.write_text("short")
    with pytest.raises(BadInput, match="shorter than 20"):
        access_of(config, {})
    path.write_text(TOKEN + "\n")
    assert access_of(config, {}).token == TOKEN


@pytest.mark.parametrize("token", ["correct horse battery staple", "x" * 20 + "/", "ü" * 20])
def test_a_token_that_a_browser_cannot_send_is_refused(token: str) -> None:
    with pytest.raises(BadInput, match="letters, digits"):
        access_of(ServiceConfig(), {"AUTONOMY_TOKEN": token})
    made = secrets.token_urlsafe(32)
    assert access_of(ServiceConfig(), {"AUTONOMY_TOKEN": made}).token == made


def test_systemd_s_token_is_used_beyond_loopback_only(tmp_path: Path) -> None:
    (tmp_path / "token").write_text(TOKEN)
    environ = {"CREDENTIALS_DIRECTORY": str(tmp_path)}
    assert access_of(ServiceConfig(host="10.0.0.7"), environ).token == TOKEN
    assert access_of(ServiceConfig(), environ).token is None


def test_a_port_that_is_taken_is_said_so() -> None:
    with listening_socket("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(PortInUse, match=f"port {port}"):
            listening_socket("127.0.0.1", port)
    with pytest.raises(BadInput, match="cannot listen"):
        listening_socket("203.0.113.1", 0)


def test_a_real_server_answers_and_ends_with_its_thread(tmp_path: Path) -> None:
    station = Station(Config(), accept)
    api = Api(station, Metrics(station), Access(None), log_folder=tmp_path)
    listening = listening_socket("127.0.0.1", 0)
    url = url_of(listening)
    with WebServer(api.application(), listening):
        with urllib.request.urlopen(f"{url}/v1/health", timeout=5) as answer:  # noqa: S310 - our own
            assert answer.status == 200
        client = Client(url)
        assert client.state().why == "starting"
        with pytest.raises(BadInput, match="there is no vehicle"):
            client.command("stop")
        with pytest.raises(BadInput, match="no such mission"):
            next(client.follow("none"))
    assert "web" not in [thread.name for thread in threading.enumerate()]
    with pytest.raises(NoService, match="autonomy serve"):
        Client(url).state()


def test_who_leaves_frees_the_workshop_at_once(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"flight a")
    station = Station(Config(), accept)
    begun = tmp_path / "begun"
    slow = "import pathlib, sys, time; pathlib.Path(sys.argv[1]).touch(); time.sleep(60)"
    workshop = Workshop({"reel": (sys.executable, "-c", slow, str(begun))})
    api = Api(station, Metrics(station), Access(None), log_folder=tmp_path, workshop=workshop)
    listening = listening_socket("127.0.0.1", 0)
    asked = b"GET /v1/logs/a.mcap/reel HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with WebServer(api.application(), listening):
        for _ in range(2):  # the second would be told 429, were the first still at it
            begun.unlink(missing_ok=True)
            with socket.create_connection(listening.getsockname()) as leaving:
                leaving.sendall(asked)
                wait_for(begun.exists)
            wait_for(lambda: not workshop.at_work)
        with socket.create_connection(listening.getsockname()) as staying:
            staying.sendall(asked)
            wait_for(lambda: workshop.at_work)
            station.enter(Phase.STOPPING, "the service has stopped")
            assert b" 503 " in staying.recv(100)


def wait_for(true: Callable[[], bool]) -> None:
    """Raises AssertionError when it does not become true."""
    for _ in range(2000):
        if true():
            return
        time.sleep(0.01)
    raise AssertionError(true)


def test_a_client_without_the_token_is_told_where_to_find_it(tmp_path: Path) -> None:
    station = Station(Config(), accept)
    api = Api(station, Metrics(station), Access(TOKEN), log_folder=tmp_path)
    listening = listening_socket("127.0.0.1", 0)
    url = url_of(listening)
    with WebServer(api.application(), listening):
        with pytest.raises(BadInput, match=r"wants a token: set AUTONOMY_TOKEN .*sudo cat"):
            Client(url).state()
        with pytest.raises(BadInput, match="does not take this token"):
            Client(url, "y" * 20).state()
        assert Client(url, TOKEN).state().why == "starting"


@pytest.mark.parametrize("url", ["", "ftp://x:1", "http://", "http://host", "http://h:99999"])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(BadInput, match="not a service's address"):
        Client(url)
