"""The service may use the devices that its drivers need, by unit, group and udev rule alike."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from autonomy.cli import refusal
from autonomy.errors import BadInput, ExitCode, NotNow
from autonomy.service.lock import SYSTEM_FOLDER, VehicleHeld
from autonomy.service.server import listening_socket
from tools.deploy.__main__ import GROUPS

PROJECT = Path(__file__).parents[3]
UNIT = PROJECT / "configs" / "autonomy.service"
RULES = PROJECT / "tools" / "deploy" / "60-autonomy.rules"
SERIAL = {"ttyACM", "ttyUSB", "ttyAMA", "ttyS", "ttyTHS"}


def values(key: str) -> list[str]:
    lines = UNIT.read_text(encoding="utf-8").splitlines()
    return [line.partition("=")[2] for line in lines if line.startswith(f"{key}=")]


def test_every_device_of_a_driver_is_allowed_and_no_other() -> None:
    assert set(values("DeviceAllow")) == {
        f"char-{name} rw" for name in SERIAL | {"i2c", "gpiochip"}
    }
    assert values("DevicePolicy") == ["closed"]


def test_the_rules_give_the_devices_to_the_groups_that_the_service_is_in() -> None:
    rules = RULES.read_text(encoding="utf-8")
    assert set(re.findall(r"tty[A-Z]+", rules)) == SERIAL
    assert set(re.findall(r'GROUP="(\w+)"', rules)) == set(GROUPS)
    assert values("SupplementaryGroups") == [" ".join(GROUPS)]


def test_a_refused_configuration_ends_it_and_what_may_come_later_does_not() -> None:
    final = {int(code) for line in values("RestartPreventExitStatus") for code in line.split()}
    assert final == {ExitCode.USAGE, BadInput.exit_code}
    assert VehicleHeld.exit_code not in final
    with listening_socket("127.0.0.1", 0) as taken:
        for host, port in (("127.0.0.1", taken.getsockname()[1]), ("203.0.113.1", 0)):
            with pytest.raises(NotNow) as refused:
                listening_socket(host, port)
            assert refusal(refused.value)[1] == ExitCode.NOT_NOW
    assert ExitCode.NOT_NOW not in final


def test_the_unit_s_first_lines_say_how_to_install_it() -> None:
    assert "python3 -m tools.deploy install" in UNIT.read_text(encoding="utf-8")[:200]


def test_systemd_understands_the_unit_where_it_is_installed() -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        return
    said = subprocess.run(
        [analyze, "verify", str(UNIT)], capture_output=True, text=True, check=False
    ).stderr
    complaints = [line for line in said.splitlines() if "autonomy" in line]
    assert all("is not executable" in line for line in complaints), complaints


def test_pilots_of_all_users_meet_where_the_unit_makes_the_folder() -> None:
    assert values("RuntimeDirectory") == [SYSTEM_FOLDER.name]
    assert values("RuntimeDirectoryMode") == ["1777"]
    assert values("RuntimeDirectoryPreserve") == ["yes"]
