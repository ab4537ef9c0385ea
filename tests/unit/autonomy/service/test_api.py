import asyncio
import hmac
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.testclient import TestClient
from starlette.types import Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.mission.failsafe import Fault
from autonomy.model import Ending, OperatorCommand, Outcome
from autonomy.service import api
from autonomy.service.api import ORDERS_BURST, Api
from autonomy.service.contract import MissionOrder, Phase, Reading
from autonomy.service.gate import BODY_BYTES_MAX, REQUESTS_BURST, Access, Bucket, Gate
from autonomy.service.metrics import Metrics
from autonomy.service.sightings import ending_faults
from autonomy.service.station import FlownMission, Instant, Station
from autonomy.service.workshop import Busy, Workshop
from hal.readings import FlightMode, LandedState, VehicleStatus

TOKEN = "a-token-of-thirty-two-characters"  # noqa: S105 - of this test alone
STREAM = "ws://127.0.0.1:8042/v1/stream"
JSON = {"content-type": "application/json"}
PATHS = (
    "/v1/state", "/v1/room", "/v1/events", "/v1/config", "/v1/faults", "/v1/missions", "/v1/logs",
    "/metrics",
)  # fmt: skip

Headers = list[tuple[bytes, bytes]]
HOME: Headers = [(b"host", b"127.0.0.1")]
HEADERS = (
    "origin", "host", "authorization", "sec-fetch-site", "sec-websocket-protocol",
    "content-length", "content-type",
)  # fmt: skip


def inside_the_fence(order: MissionOrder) -> None:
    if abs(order.goals[0][0]) > 10.0:
        raise BadInput("goal 1 is outside the geofence; choose a goal inside it")


@pytest.fixture
def station() -> Station:
    station = Station(Config(), inside_the_fence)
    status = VehicleStatus(0.0, False, FlightMode.HOLD, LandedState.ON_GROUND, 0.0)
    station.at_rest(Instant(0.0, status, {}))
    station.enter(Phase.READY, "PX4 is ready for a mission")
    return station


def client_of(
    station: Station,
    folder: Path,
    access: Access = Access(None),  # noqa: B008 - immutable
    workshop: Workshop | None = None,
    clock_s: Callable[[], float] = time.monotonic,
) -> TestClient:
    api = Api(
        station,
        Metrics(station),
        access,
        log_folder=folder,
        workshop=workshop,
        clock_s=clock_s,
    )
    return TestClient(
        api.application(), base_url="http://127.0.0.1:8042", raise_server_exceptions=False
    )


@pytest.fixture
def client(station: Station, tmp_path: Path) -> Iterator[TestClient]:
    with client_of(station, tmp_path) as client:
        yield client


def nothing_was_asked(station: Station) -> bool:
    return station.take_mission() is None and station.take_commands() == ()


def test_every_document_can_be_read(client: TestClient) -> None:
    for path in (*PATHS, "/v1/health", "/v1/openapi.json", "/", "/web/page.js", "/web/style.css"):
        answer = client.get(path)
        assert answer.status_code == 200, path
        assert "default-src 'self'" in answer.headers["content-security-policy"]


def test_a_mission_is_created_listed_read_and_taken_back(
    client: TestClient, station: Station
) -> None:
    created = client.post("/v1/missions", json={"goals": [[4, 3]], "altitude_m": 1.2})
    assert created.status_code == 201
    name = created.json()["id"]
    assert [m["id"] for m in client.get("/v1/missions").json()] == [name]
    assert client.get(f"/v1/missions/{name}").json()["status"] == "queued"
    again = client.post("/v1/missions", json={"goals": [[4, 3]]})
    assert (again.status_code, name in again.json()["error"]) == (409, True)
    assert client.delete(f"/v1/missions/{name}").json()["status"] == "cancelled"
    assert nothing_was_asked(station)


@pytest.mark.parametrize("name", ["stop", "hold", "resume", "land"])
def test_an_order_is_queued_and_never_limited(
    client: TestClient, station: Station, name: str
) -> None:
    for _ in range(ORDERS_BURST * 3):
        assert client.post(f"/v1/{name}").status_code == 202
    assert set(station.take_commands()) == {OperatorCommand(name)}


def test_too_many_missions_at_once_are_refused(station: Station, tmp_path: Path) -> None:
    with client_of(station, tmp_path, clock_s=lambda: 7.0) as client:
        codes = [
            client.post("/v1/missions", content=b"{}", headers=JSON).status_code
            for _ in range(ORDERS_BURST + 2)
        ]
    assert codes == [422] * ORDERS_BURST + [429] * 2


def test_the_bucket_fills_again() -> None:
    bucket = Bucket(per_s=2.0, burst=2)
    assert [bucket.take(10.0) for _ in range(3)] == [True, True, False]
    assert [bucket.take(10.6), bucket.take(10.6), bucket.take(99.0)] == [True, False, True]


async def asked_often(path: str, method: str, headers: Headers = HOME) -> list[int]:
    """The answers of a gate, before an application that answers nothing, at one instant."""
    return await answers_of(Gate(silent, Access(None), lambda: 7.0), path, method, headers)


async def silent(_: Scope, receive: Receive, send: Send) -> None:
    """Answers 200 and nothing."""
    await send({"type": "http.response.start", "status": 200, "headers": []})


async def answers_of(
    gate: Gate,
    path: str,
    method: str,
    headers: Headers,
    times: int = REQUESTS_BURST + 10,
    client: str = "10.0.0.7",
) -> list[int]:
    """The status of each of so many equal requests."""
    answers: list[int] = []

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            answers.append(message["status"])

    async def receive() -> Message:
        return {"type": "http.request"}

    scope = {"type": "http", "path": path, "method": method, "headers": headers}
    for _ in range(times):
        await gate(scope | {"client": (client, 4711)}, receive, send)
    return answers


async def test_whoever_asks_too_often_is_told_to_wait() -> None:
    answers = await asked_often("/v1/state", "GET")
    assert answers == [200] * REQUESTS_BURST + [429] * 10


@pytest.mark.parametrize(
    ("path", "method"), [("/v1/stop", "POST"), ("/v1/land", "POST"), ("/v1/missions/7", "DELETE")]
)
async def test_no_flood_keeps_a_stop_out(path: str, method: str) -> None:
    assert set(await asked_often(path, method)) == {200}


async def test_a_flood_without_the_token_takes_nothing_from_who_has_it() -> None:
    gate = Gate(silent, Access(TOKEN, None), lambda: 7.0)
    known = [*HOME, (b"authorization", f"Bearer {TOKEN}".encode())]
    for path in ("/", "/v1/state"):
        flood = await answers_of(gate, path, "GET", HOME, 2 * REQUESTS_BURST)
        assert flood.count(429) >= REQUESTS_BURST
    assert await answers_of(gate, "/v1/stop", "POST", HOME, 1) == [429]
    assert await answers_of(gate, "/v1/state", "GET", known, 1) == [200]
    assert await answers_of(gate, "/", "GET", HOME, 1, "10.0.0.8") == [200]


async def test_another_page_s_flood_takes_nothing_from_the_page_itself() -> None:
    gate = Gate(silent, Access(None), lambda: 7.0)
    foreign = [*HOME, (b"sec-fetch-site", b"cross-site"), (b"sec-fetch-mode", b"no-cors")]
    assert set(await answers_of(gate, "/v1/state", "GET", foreign)) == {403}
    assert await answers_of(gate, "/v1/state", "GET", HOME, 1) == [200]
    link = [*HOME, (b"sec-fetch-site", b"cross-site"), (b"sec-fetch-mode", b"navigate")]
    assert await answers_of(gate, "/", "GET", link, 1) == [200]
    assert await answers_of(gate, "/metrics", "GET", link, 1) == [403]


async def test_as_many_addresses_as_there_are_fill_no_memory_and_shut_nobody_out() -> None:
    gate = Gate(silent, Access(TOKEN, None), lambda: 7.0)
    for number in range(1000):
        assert await answers_of(gate, "/", "GET", HOME, 1, f"10.0.{number}") == [200]
    assert len(gate._strangers._buckets) <= 256


@given(st.text(st.characters(max_codepoint=255), max_size=30), st.sampled_from(HEADERS))
async def test_no_header_is_answered_with_a_defect(text: str, name: str) -> None:
    gate = Gate(silent, Access(TOKEN, None), lambda: 7.0)
    for value in (text, f"http://{text}", f"bearer {text}"):
        headers = [*HOME, (name.encode(), value.encode("latin-1"))]
        (status,) = await answers_of(gate, "/v1/missions", "POST", headers, 1)
        assert 400 <= status < 500


def test_an_origin_that_is_no_address_is_another_page(client: TestClient) -> None:
    for origin in ("http://[", "http://[::1", "http://]", "http://\u212a"):
        assert client.get("/v1/state", headers={b"origin": origin.encode()}).status_code == 403


MALFORMED: tuple[bytes, ...] = (
    b"", b"{", b"[]", b"null", b"{}", b'{"goals": []}', b'{"goals": [[1]]}',
    b'{"goals": [[1, 2, 3, 4]]}', b'{"goals": [[NaN, 1]]}', b'{"goals": [[1e999, 1]]}',
    b'{"goals": [["1", 2]]}', b'{"goals": [[1, 2]], "goal": 1}',
    b'{"goals": [[1, 2]], "frame": "x"}',
    b'{"goals": [[1, 2]], "altitude_m": -1}', b'{"goals": [[1, 2]], "altitude_m": 0}',
    b'{"goals": [[99999, 2]]}', b"\xff\xfe", b'{"goals": [[1, 2]], "land": "yes"}',
    b'{"goals": [' + b"[1,2]," * 40 + b"[1,2]]}",
)  # fmt: skip


@pytest.mark.parametrize("body", MALFORMED)
def test_what_is_no_mission_is_refused_with_a_sentence_and_moves_nothing(
    client: TestClient, station: Station, body: bytes
) -> None:
    answer = client.post("/v1/missions", content=body, headers=JSON)
    assert answer.status_code == 422
    assert answer.json()["error"].startswith("this is not a mission")
    assert nothing_was_asked(station)


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats(allow_nan=False)
        | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(st.sampled_from(["goals", "frame", "land", "x"]), inner, max_size=4)
        ),
        max_leaves=12,
    )
)
def test_no_body_is_answered_with_a_defect(station: Station, tmp_path: Path, value: Any) -> None:
    client = client_of(station, tmp_path)
    body = msgspec.json.encode(value) if abs_fits(value) else b"0"
    assert client.post("/v1/missions", content=body, headers=JSON).status_code in (
        201,
        409,
        422,
        429,
    )
    station.command(OperatorCommand.STOP)
    station.take_commands()


def abs_fits(value: Any) -> bool:
    """msgspec writes integers of up to 64 bits."""
    try:
        msgspec.json.encode(value)
    except (OverflowError, ValueError):
        return False
    return True


def test_a_goal_that_must_not_be_flown_is_refused_with_its_sentence(client: TestClient) -> None:
    answer = client.post("/v1/missions", json={"goals": [[11, 0]]})
    assert (answer.status_code, "outside the geofence" in answer.json()["error"]) == (422, True)


def test_a_body_that_is_too_long_or_not_json_is_not_read(
    client: TestClient, station: Station
) -> None:
    long = b'{"goals": [[1, 2]]' + b" " * BODY_BYTES_MAX + b"}"
    assert client.post("/v1/missions", content=long, headers=JSON).status_code == 413
    plain = {"content-type": "text/plain"}
    good = b'{"goals": [[1, 2]]}'
    assert client.post("/v1/missions", content=good, headers=plain).status_code == 415

    def chunks() -> Iterator[bytes]:
        for _ in range(20):
            yield b" " * 1024

    assert client.post("/v1/missions", content=chunks(), headers=JSON).status_code == 413
    assert nothing_was_asked(station)


@pytest.mark.parametrize(
    "path", ["/v1/missions/none", "/v1/nothing", "/web/..%2fapi.py", "/web/none"]
)
def test_what_is_not_there_is_said_so(client: TestClient, path: str) -> None:
    answer = client.get(path)
    assert (answer.status_code, list(answer.json())) == (404, ["error"])


def test_a_method_that_does_not_fit_is_refused(client: TestClient, station: Station) -> None:
    assert client.get("/v1/stop").status_code == 405
    assert client.put("/v1/missions", json={}).status_code == 405
    assert nothing_was_asked(station)


# ---------------------------------------------------------------- who may ask


def test_other_web_pages_cannot_command(client: TestClient, station: Station) -> None:
    for headers in (
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:9999"},
    ):
        assert client.post("/v1/stop", headers=headers).status_code == 403
    assert client.post("/v1/stop", headers={"host": "evil.example"}).status_code == 421
    assert nothing_was_asked(station)
    own = {"origin": "http://127.0.0.1:8042"}
    assert client.post("/v1/stop", headers=own).status_code == 202


def test_with_a_token_nothing_of_worth_is_told_without_it(station: Station, tmp_path: Path) -> None:
    client = client_of(station, tmp_path, Access(TOKEN, None))
    for path in PATHS:
        assert client.get(path).status_code == 401
        wrong = {"authorization": f"Bearer {TOKEN}x"}
        assert client.get(path, headers=wrong).status_code == 401
        assert client.get(path, headers={"authorization": f"Bearer {TOKEN}"}).status_code == 200
    assert client.post("/v1/stop").status_code == 401
    assert client.get("/v1/health").status_code == 200
    assert nothing_was_asked(station)


def test_tokens_are_compared_in_a_time_that_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    compared = []

    def digest(given: bytes, kept: bytes) -> bool:
        compared.append((given, kept))
        return given == kept

    monkeypatch.setattr(hmac, "compare_digest", digest)
    assert Access(TOKEN, None).token_fits(TOKEN)
    assert not Access(TOKEN, None).token_fits("x")
    assert compared == [(TOKEN.encode(), TOKEN.encode()), (b"x", TOKEN.encode())]


@pytest.mark.parametrize("given", ["", "ä", TOKEN[:-1], TOKEN + "\n", TOKEN.upper()])
def test_only_the_token_itself_fits(given: str) -> None:
    assert not Access(TOKEN, None).token_fits(given)


# ---------------------------------------------------------------- the stream


def test_the_stream_begins_with_the_room_and_goes_on_with_the_state(client: TestClient) -> None:
    with client.websocket_connect(STREAM) as socket:
        kinds = [socket.receive_json()["type"] for _ in range(5)]
    assert kinds[0] == "room"
    assert "event" in kinds
    assert kinds[-1] == "state"


async def test_a_watcher_who_takes_nothing_is_let_go(
    station: Station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(api, "_SEND_S", 0.02)
    monkeypatch.setattr(api, "_FAREWELL_S", 0.02)
    metrics = Metrics(station)
    application = Api(station, metrics, Access(None), log_folder=tmp_path).application()
    arriving: asyncio.Queue[Message] = asyncio.Queue()
    arriving.put_nowait({"type": "websocket.connect"})
    asked: list[Message] = []

    async def send(message: Message) -> None:
        asked.append(message)
        if message["type"] != "websocket.accept":
            await asyncio.Event().wait()

    headers = [(b"host", b"127.0.0.1")]
    scope = {"type": "websocket", "path": "/v1/stream", "headers": headers, "subprotocols": []}
    await application(scope, arriving.get, send)
    assert [message["type"] for message in asked][-1] == "websocket.close"
    assert asked[-1]["code"] == 1013
    assert b"autonomy_streams 0.0" in metrics.text()


def test_the_stream_is_refused_without_a_token(station: Station, tmp_path: Path) -> None:
    closed = client_of(station, tmp_path, Access(TOKEN, None))
    refused(closed)
    offered = ["autonomy.v1", f"bearer.{TOKEN}"]
    with closed.websocket_connect(STREAM, subprotocols=offered) as socket:
        assert str(socket.accepted_subprotocol) == "autonomy.v1"
        assert socket.receive_json()["type"] == "room"


def test_the_stream_is_refused_to_other_pages(client: TestClient) -> None:
    refused(client, origin="http://evil.example")


def refused(client: TestClient, **headers: str) -> None:
    with pytest.raises(WebSocketDisconnect):
        client.websocket_connect(STREAM, headers=headers).__enter__()


# ---------------------------------------------------------------- logs


def test_logs_are_listed_with_their_reports_and_downloaded(
    client: TestClient, tmp_path: Path
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"flight a")
    (tmp_path / "a.mcap.report.json").write_text('{"ending": "goal_reached"}')
    (tmp_path / "b.mcap").write_bytes(b"flight b")
    (tmp_path / "b.mcap.report.json").write_text("{cut")
    (tmp_path / "secret.txt").write_text("x")
    listed = {log["name"]: log["report"] for log in client.get("/v1/logs").json()}
    assert listed == {"a.mcap": {"ending": "goal_reached"}, "b.mcap": None}
    assert client.get("/v1/logs/a.mcap").content == b"flight a"


@pytest.mark.parametrize(
    "name", ["secret.txt", "..%2Fsecret.mcap", "link.mcap", "folder.mcap", "%00", "a.mcap%00"]
)
def test_nothing_beside_the_logs_can_be_read(client: TestClient, tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.txt").write_text("x")
    (tmp_path.parent / "secret.mcap").write_text("x")
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "link.mcap").symlink_to("/etc/hostname")
    assert client.get(f"/v1/logs/{name}").status_code == 404


def program(code: str) -> tuple[str, ...]:
    return (sys.executable, "-c", code)


LOUD = program("import gzip, sys; sys.stdout.buffer.write(gzip.compress(sys.argv[1].encode()))")
SORRY = program("import sys; sys.exit('x\\nthis log is cut off')")
SLOW = program("import time; time.sleep(60)")


@pytest.mark.parametrize("what", ["reel", "report"])
def test_what_is_made_of_a_log_comes_from_a_program_of_its_own(
    station: Station, tmp_path: Path, what: str
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"flight a")
    with client_of(station, tmp_path, workshop=Workshop({what: LOUD})) as client:
        answer = client.get(f"/v1/logs/a.mcap/{what}")
        assert client.get(f"/v1/logs/b.mcap/{what}").status_code == 404
    assert (answer.status_code, answer.text) == (200, str(tmp_path / "a.mcap"))
    assert ("sandbox" in answer.headers["content-security-policy"]) == (what == "report")


@pytest.mark.parametrize(
    ("command", "timeout_s", "said"),
    [(SORRY, 60.0, "this log is cut off"), (SLOW, 0.2, "use autonomy report")],
)
def test_what_cannot_be_made_is_said_so(
    station: Station, tmp_path: Path, command: tuple[str, ...], timeout_s: float, said: str
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"flight a")
    workshop = Workshop({"reel": command}, timeout_s=timeout_s)
    with client_of(station, tmp_path, workshop=workshop) as client:
        answer = client.get("/v1/logs/a.mcap/reel")
    assert (answer.status_code, said in answer.json()["error"]) == (422, True)


async def test_one_thing_is_made_at_a_time_and_none_when_nobody_waits(tmp_path: Path) -> None:
    workshop = Workshop({"reel": SLOW})
    async with asyncio.TaskGroup() as group:
        first = group.create_task(workshop.make("reel", tmp_path))
        await asyncio.sleep(0.2)
        with pytest.raises(Busy):
            await workshop.make("reel", tmp_path)
        first.cancel()
    assert first.cancelled()


async def test_how_much_of_a_log_is_read_is_told_while_it_is(tmp_path: Path) -> None:
    code = "import sys, time; print('share 0.41\\nshare 0.42', file=sys.stderr, flush=True)"
    workshop = Workshop({"reel": (sys.executable, "-c", f"{code}; time.sleep(60)")})
    assert workshop.reading == Reading()
    async with asyncio.TaskGroup() as group:
        making = group.create_task(workshop.make("reel", tmp_path / "a.mcap"))
        for _ in range(6000):
            if workshop.reading.share > 0.0:
                break
            await asyncio.sleep(0.01)
        assert workshop.reading == Reading("a.mcap", 0.42)
        making.cancel()
    assert workshop.reading == Reading()


def test_nothing_is_read_where_nobody_looks_back(client: TestClient) -> None:
    assert client.get("/v1/reading").json() == {"log": None, "share": 0.0}


def test_faults_are_told_with_what_was_seen_of_them(client: TestClient, station: Station) -> None:
    before = client.get("/v1/faults").json()
    assert {row["name"] for row in before} == {fault.value for fault in Fault}
    assert not any(row["active"] or row["times"] for row in before)
    assert [row["response"] for row in before][:3] == ["let go"] * 3
    station.begin(FlownMission("m", ((1.0, 0.0),), (0.0, 0.0)))
    assert station.drawn is not None
    for now_s, present in ((1.0, ("drift",)), (1.05, ("drift",)), (1.1, ()), (2.0, ("drift",))):
        station.drawn.faults.note(now_s, present)
    after = {row["name"]: row for row in client.get("/v1/faults").json()}
    drift = after["drift"]
    assert (drift["active"], drift["times"], drift["first_s"], drift["last_s"]) == (True, 2, 1, 2)
    assert not after["battery_low"]["active"]


@pytest.mark.parametrize(
    ("ending", "armed", "in_failsafe", "fault"),
    [
        (Ending.GOAL_REACHED, True, False, None),
        (Ending.UNREACHABLE, True, False, Fault.UNREACHABLE),
        (Ending.TAKEN_OVER, True, False, Fault.PILOT_TAKEOVER),
        (Ending.TAKEN_OVER, True, True, Fault.OFFBOARD_LOST),
        (Ending.TAKEN_OVER, False, True, Fault.DISARMED),
    ],
)
def test_what_ends_a_flight_is_seen_as_the_fault_it_is(
    ending: Ending, armed: bool, in_failsafe: bool, fault: Fault | None
) -> None:
    status = VehicleStatus(
        0.0, armed, FlightMode.HOLD, LandedState.IN_AIR, 0.0, in_failsafe=in_failsafe
    )
    found = ending_faults(Outcome(ending, "why"), status)
    assert found == (() if fault is None else (fault.value,))
    assert ending_faults(None, status) == ()


def test_a_folder_that_is_not_there_holds_no_logs(station: Station, tmp_path: Path) -> None:
    client = client_of(station, tmp_path / "none")
    assert client.get("/v1/logs").json() == []


# ---------------------------------------------------------------- descriptions


def test_the_description_names_every_path_and_only_those(
    station: Station, tmp_path: Path, client: TestClient
) -> None:
    described = client.get("/v1/openapi.json").json()
    for path, operations in described["paths"].items():
        concrete = path.replace("{id}", "none").replace("{name}", "none")
        for method in set(operations) - {"parameters"}:
            answer = client.request(method.upper(), concrete)
            assert answer.status_code != 405, (method, path)
            assert str(answer.status_code) in operations[method]["responses"], (method, path)
    references = msgspec.json.encode(described).decode().split('"#/components/schemas/')[1:]
    for reference in references:
        assert reference.partition('"')[0] in described["components"]["schemas"]


def test_the_page_needs_nothing_from_elsewhere() -> None:
    folder = Path(__file__).parents[4] / "autonomy" / "service" / "web"
    for path in folder.iterdir():
        text = path.read_text().replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text, path
        assert "https://" not in text, path
        assert " style=" not in text, path
        assert "<script>" not in text, path
