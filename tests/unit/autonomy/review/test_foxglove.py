"""A flight as Foxglove's messages: every schema and every path of the layout is what is there."""

import base64
import importlib
import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
from click.testing import CliRunner
from google.protobuf import json_format
from mcap.reader import make_reader

from autonomy.cli import main
from autonomy.errors import ExitCode
from autonomy.flightlog.reader import FlightLog
from autonomy.review.foxglove import messages as fox
from autonomy.review.foxglove.scene import TOPICS
from hal.frames import rotate_frd_to_ned
from tests.support.recorded import fly

Messages = dict[str, list[tuple[float, dict[str, Any]]]]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, _ = fly(tmp_path_factory.mktemp("flown"), scenario="default")
    answer = CliRunner().invoke(main, ["export", str(path)])
    assert answer.exit_code == 0, answer.output
    return path


@pytest.fixture(scope="module")
def exported(flown: Path) -> Messages:
    """By topic: (time, message)."""
    found: Messages = defaultdict(list)
    with flown.with_suffix(".foxglove.mcap").open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found[channel.topic].append((message.log_time / 1e9, json.loads(message.data)))
    return found


def schemas(flown: Path) -> dict[str, tuple[str, dict[str, Any]]]:
    """By topic: the name and the content of its schema, as they stand in the file."""
    with flown.with_suffix(".foxglove.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return {
        channel.topic: (
            summary.schemas[channel.schema_id].name,
            json.loads(summary.schemas[channel.schema_id].data),
        )
        for channel in summary.channels.values()
    }


def test_every_message_is_what_its_schema_says(flown: Path, exported: Messages) -> None:
    for topic, (_, schema) in schemas(flown).items():
        validator = jsonschema_rs.validator_for(schema)
        for _, message in exported[topic]:
            validator.validate(message)


def as_protobuf(value: Any, key: str = "") -> Any:
    """Foxglove's JSON as protobuf's: times and durations are spelled otherwise there."""
    if isinstance(value, list):
        return [as_protobuf(each, key) for each in value]
    if not isinstance(value, dict):
        return value
    if value.keys() == {"sec", "nsec"}:
        if key == "lifetime":
            return f"{value['sec']}.{value['nsec']:09d}s"
        minutes, seconds = divmod(value["sec"], 60)
        assert minutes < 60, "the clock of a simulation begins at nothing"
        return f"1970-01-01T00:{minutes:02d}:{seconds:02d}.{value['nsec']:09d}Z"
    return {name: as_protobuf(each, name) for name, each in value.items()}


def test_well_known_messages_decode_with_foxgloves_own_definitions(
    flown: Path, exported: Messages
) -> None:
    decoded = set()
    for topic, (name, _) in schemas(flown).items():
        if not name.startswith("foxglove."):
            continue
        word = name.removeprefix("foxglove.")
        definition = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{word}_pb2"), word)
        for _, message in exported[topic][:: max(1, len(exported[topic]) // 40)]:
            json_format.ParseDict(as_protobuf(message), definition())
        decoded.add(word)
    assert decoded == {
        "FrameTransforms",
        "PoseInFrame",
        "SceneUpdate",
        "Grid",
        "PointCloud",
        "Log",
    }


def test_schemas_are_in_one_piece_and_of_types_that_foxglove_knows(flown: Path) -> None:
    """Its reader follows no references, and refuses what may be one of several types."""

    def check(node: dict[str, Any]) -> None:
        assert node["type"] in ("object", "array", "string", "number", "integer", "boolean")
        for each in node.get("properties", {}).values():
            check(each)
        if node["type"] == "array":
            check(node["items"])

    for name, schema in schemas(flown).values():
        assert name == schema["title"]
        check(schema)


def strings(node: Any) -> Iterator[str]:
    """Every string in the layout, keys included."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield key
            yield from strings(value)
    elif isinstance(node, list):
        for value in node:
            yield from strings(value)
    elif isinstance(node, str):
        yield node


def layout() -> dict[str, Any]:
    text = (resources.files("autonomy.review.foxglove") / "layout.json").read_text("utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


def test_every_topic_and_path_of_the_layout_is_in_an_export(
    flown: Path, exported: Messages
) -> None:
    named = [text for text in strings(layout()["configById"]) if text.startswith("/")]
    assert len(named) > 25
    for text in named:
        path = re.fullmatch(r"((?:/[a-z0-9]+)+)(?:\.(\w+))?", text)
        assert path is not None, text
        topic, field = path.groups()
        assert exported[topic], f"nothing is ever on {topic}"
        if field is not None and not field.endswith("ceiling"):  # this room has none
            assert field in schemas(flown)[topic][1]["properties"]
            assert any(field in message for _, message in exported[topic]), text


def test_the_layout_places_every_panel_that_it_has() -> None:
    placed = {text for text in strings(layout()["layout"]) if "!" in text}
    assert placed == set(layout()["configById"])


def test_every_topic_is_declared_and_the_flight_says_something_on_it(exported: Messages) -> None:
    assert set(exported) == set(TOPICS)


def test_the_export_is_the_flight_tick_by_tick(flown: Path, exported: Messages) -> None:
    ticks = list(FlightLog.open(flown))
    assert len(exported["/state"]) == len(exported["/beams"]) == len(ticks)
    at = len(ticks) // 2
    tick = ticks[at]
    decision = tick.command.decision
    time_s, state = exported["/state"][at]
    assert time_s == pytest.approx(tick.inputs.now_s, abs=1e-8)
    assert state["state"] == decision.state.value
    assert state["clearance_m"] == decision.clearance_m
    fused = decision.fused
    assert fused is not None
    poses = dict(exported["/pose"])
    position = poses[time_s]["pose"]["position"]
    assert (position["x"], position["y"], position["z"]) == fused.position_ned_m
    sent = dict(exported["/setpoint/sent"])[time_s]
    setpoint = tick.command.setpoint
    assert setpoint is not None
    assert sent["velocity_east_m_s"] == setpoint.velocity_ned_m_s[1]
    told = [event.why for tick in ticks for event in tick.command.decision.events]
    said = [message["message"] for _, message in exported["/events"]]
    assert all(any(why in text for text in said) for why in told)
    plans = [tick for tick in ticks if tick.command.decision.plan is not None]
    assert len(exported["/plan"]) == len(plans) + 1  # and the empty one at the beginning


def test_beams_end_where_the_map_has_hits(exported: Messages) -> None:
    """Through the frames: what a beam saw, turned by /tf, lies on a hit of /hits."""
    times = {round(t, 6): m["transforms"] for t, m in exported["/tf"]}
    time_s, cloud = exported["/hits"][len(exported["/hits"]) // 2]
    packed = memoryview(base64.b64decode(cloud["data"])).cast("f")
    hits = [(packed[k], packed[k + 1]) for k in range(0, len(packed), 3)]
    assert len(hits) > 10
    gaps = []
    for at_s, update in exported["/beams"]:
        body = next((t for t in times[round(at_s, 6)] if t["child_frame_id"] == "body"), None)
        if body is None or not time_s - 3.0 < at_s <= time_s:
            continue
        for line in update["entities"][0]["lines"]:
            end = line["points"][1]
            if line["color"]["b"] > 0.5 or abs(end["z"]) > 0.1:  # saw nothing, or up and down
                continue
            turned = rotate_frd_to_ned((end["x"], end["y"], end["z"]), *euler(body["rotation"]))
            north = turned[0] + body["translation"]["x"]
            east = turned[1] + body["translation"]["y"]
            gaps.append(min(math.hypot(north - n, east - e) for n, e in hits))
    assert len(gaps) > 5
    assert sorted(gaps)[len(gaps) // 2] < 0.06


def euler(q: dict[str, float]) -> tuple[float, float, float]:
    x, y, z, w = q["x"], q["y"], q["z"], q["w"]
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(2 * (w * y - z * x)),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


@pytest.mark.parametrize("angles", [(0.0, 0.0, 2.0), (0.3, 0.0, 0.0), (0.2, -0.4, -2.9)])
def test_an_attitude_survives_as_a_quaternion(angles: tuple[float, float, float]) -> None:
    q = fox.quaternion_of(*angles)
    again = euler({"x": q.x, "y": q.y, "z": q.z, "w": q.w})
    assert again == pytest.approx(angles)


def test_a_log_that_was_cut_is_exported_up_to_the_cut_and_the_layout_is_handed_out(
    flown: Path, tmp_path: Path
) -> None:
    with flown.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    last = summary.chunk_indexes[-1]
    # What a simulated flight writes in one go may be one chunk: cut behind the last.
    length = last.chunk_start_offset + last.chunk_length + last.message_index_length // 2
    (tmp_path / "cut.mcap").write_bytes(flown.read_bytes()[:length])
    out, layout_path = tmp_path / "a.mcap", tmp_path / "layout.json"
    arguments = ["export", str(tmp_path / "cut.mcap"), "--out", str(out)]
    answer = CliRunner().invoke(main, [*arguments, "--layout", str(layout_path)])
    assert answer.exit_code == 0
    assert "cut off" in answer.stderr
    with out.open("rb") as file:
        assert make_reader(file).get_summary() is not None
    assert json.loads(layout_path.read_text("utf-8")) == layout()


def test_what_cannot_be_written_is_a_sentence(flown: Path, tmp_path: Path) -> None:
    for target, words in ((tmp_path / "no" / "a.mcap", "cannot be written"), (flown, "itself")):
        answer = CliRunner().invoke(main, ["export", str(flown), "--out", str(target)])
        assert answer.exit_code == int(ExitCode.BAD_INPUT)
        assert words in answer.stderr
