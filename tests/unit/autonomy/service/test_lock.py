import os
import stat
from pathlib import Path

import msgspec
import pytest

from autonomy.errors import BadInput
from autonomy.service import lock as locks
from autonomy.service.lock import (
    Holder,
    VehicleHeld,
    VehicleLock,
    address_path,
    endpoint,
    holder_of,
    why_not_believed,
)

URL = "udpin://0.0.0.0:14540"


def holder(name: str = "autonomy fly") -> Holder:
    return Holder(name, os.getpid(), "2026-11-22T04:00:00")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("udpin://0.0.0.0:14540", "udpin://127.0.0.1:14540", True),
        ("udpin://0.0.0.0:14540", "udpin://0.0.0.0:14541", False),
        ("serial:///dev/ttyACM0:921600", "serial:///dev/ttyACM0:57600", True),
        ("serial:///dev/ttyACM0", "serial:///dev/ttyACM1", False),
        ("tcpout://10.0.0.2:5760", "tcpout://10.0.0.3:5760", False),
    ],
)
def test_urls_of_one_endpoint_share_one_lock(one: str, other: str, same: bool) -> None:
    assert (endpoint(one) == endpoint(other)) is same


@pytest.mark.parametrize("url", ["../../etc/passwd", "serial:///dev/../x", "udpin://0.0.0.0", ""])
def test_an_endpoint_is_always_one_plain_file_name(url: str) -> None:
    assert "/" not in endpoint(url)


def test_a_second_pilot_is_refused_and_told_who_holds_the_vehicle(tmp_path: Path) -> None:
    with VehicleLock(URL, holder("autonomy serve"), tmp_path) as lock:
        lock.reachable_at("http://127.0.0.1:8042")
        with (
            pytest.raises(VehicleHeld, match=f"held by autonomy serve .process {os.getpid()}") as e,
            VehicleLock(URL, holder(), tmp_path),
        ):
            pass
        assert e.value.holder is not None
        assert e.value.holder.api == "http://127.0.0.1:8042"
        assert holder_of(URL, tmp_path) == e.value.holder
    assert holder_of(URL, tmp_path) is None


def test_what_others_may_write_into_the_lock_moves_no_token(tmp_path: Path) -> None:
    with VehicleLock(URL, holder("autonomy serve"), tmp_path) as lock:
        true = msgspec.structs.replace(holder("autonomy serve"), api="http://127.0.0.1:8042")
        lock.reachable_at("http://127.0.0.1:8042")
        forged = msgspec.structs.replace(holder("autonomy serve"), api="http://127.0.0.1:666")
        lock.path.write_bytes(msgspec.json.encode(forged))
        assert holder_of(URL, tmp_path) == true
        lock.path.write_bytes(msgspec.json.encode(msgspec.structs.replace(forged, pid=1)))
        found = holder_of(URL, tmp_path)
        assert found is not None
        assert found.api is None
    assert not address_path(lock.path).exists()


@pytest.mark.parametrize("kind", ["writable", "pipe", "link", "folder", "torn"])
def test_an_address_that_another_could_have_written_is_not_believed(
    tmp_path: Path, kind: str
) -> None:
    with VehicleLock(URL, holder(), tmp_path) as lock:
        lock.reachable_at("http://127.0.0.1:8042")
        path = address_path(lock.path)
        if kind == "writable":
            path.chmod(0o666)
        elif kind == "torn":
            path.write_bytes(path.read_bytes()[:-3])
        else:
            path.rename(tmp_path / "kept")
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "link":
            path.symlink_to(tmp_path / "kept")
        elif kind == "folder":
            path.mkdir()
        found = holder_of(URL, tmp_path)
        assert found is not None
        assert found.api is None
        if kind == "writable":
            with (
                pytest.raises(VehicleHeld, match="is not believed"),
                VehicleLock(URL, holder(), tmp_path),
            ):
                pass


def test_an_address_is_believed_of_root_oneself_and_the_service_s_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, somebody = stat.S_IFREG | 0o644, 54321
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert not why_not_believed(0, plain, tmp_path)
    assert not why_not_believed(1000, plain, tmp_path)
    assert f"user {somebody}" in why_not_believed(somebody, plain, tmp_path)
    assert why_not_believed(0, stat.S_IFREG | 0o664, tmp_path)
    monkeypatch.setattr(locks, "SYSTEM_FOLDER", tmp_path)
    monkeypatch.setattr(os, "geteuid", lambda: 54320)
    assert not why_not_believed(tmp_path.stat().st_uid, plain, tmp_path)
    assert why_not_believed(somebody, plain, tmp_path)


def test_the_address_a_killed_service_left_is_not_the_next_pilot_s(tmp_path: Path) -> None:
    lock = VehicleLock(URL, holder("autonomy serve"), tmp_path)
    with lock:
        lock.reachable_at("http://127.0.0.1:8042")
        left = address_path(lock.path).read_bytes()
    address_path(lock.path).write_bytes(left)
    with VehicleLock(URL, holder("autonomy fly"), tmp_path):
        assert holder_of(URL, tmp_path) == holder("autonomy fly")


def test_another_vehicle_is_free(tmp_path: Path) -> None:
    with (
        VehicleLock(URL, holder(), tmp_path),
        VehicleLock("udpin://0.0.0.0:14550", holder(), tmp_path),
    ):
        pass


def test_a_shorter_name_leaves_nothing_of_a_longer_one_before(tmp_path: Path) -> None:
    with VehicleLock(URL, holder("a very long name " * 20), tmp_path):
        pass
    with VehicleLock(URL, holder("short"), tmp_path):
        assert holder_of(URL, tmp_path) == holder("short")


def test_a_lock_that_names_nobody_still_locks(tmp_path: Path) -> None:
    with VehicleLock(URL, holder(), tmp_path) as lock:
        lock.path.write_text("scribble")
        with (
            pytest.raises(VehicleHeld, match="another process"),
            VehicleLock(URL, holder(), tmp_path),
        ):
            pass


def test_a_link_in_the_lock_s_place_is_not_followed(tmp_path: Path) -> None:
    lock = VehicleLock(URL, holder(), tmp_path)
    target = tmp_path / "precious"
    target.write_text("keep")
    lock.path.symlink_to(target)
    with pytest.raises(BadInput, match="cannot be opened"), lock:
        pass
    assert target.read_text() == "keep"


def test_the_next_pilot_may_be_another_user(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        with VehicleLock(URL, holder(), tmp_path) as lock:
            assert stat.S_IMODE(lock.path.stat().st_mode) == 0o666
    finally:
        os.umask(before)
