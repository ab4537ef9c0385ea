"""A plain sentence for everything that is wrong before flying."""

import os
from pathlib import Path

from autonomy.config import Config, MoversConfig
from autonomy.doctor import check_disk, check_machine, check_movers, check_packages, check_python
from autonomy.finding import Finding
from autonomy.local_check import check_local
from autonomy.vehicle_check import check_beams
from hal.config import BeamsConfig, SerialGnssConfig
from hal.readings import RangeReading, RangeStatus


def test_this_machine_is_fit_to_run_its_own_tests(tmp_path: Path) -> None:
    findings = check_machine(Config(), tmp_path / "not" / "yet" / "there")
    assert [str(finding) for finding in findings if not finding.good] == []
    assert not (tmp_path / "not").exists()


def beams(*half_angles_deg: float) -> BeamsConfig:
    mounts = [
        {"name": f"b{n}", "yaw_deg": 90.0 * n, "half_angle_deg": half_angle_deg}
        for n, half_angle_deg in enumerate(half_angles_deg)
    ]
    return BeamsConfig.model_validate(
        {"mounts": [*mounts, {"name": "up", "pitch_deg": 90.0, "half_angle_deg": 0.0}]}
    )


def test_wide_beams_that_see_nothing_move_are_told() -> None:
    (told,) = check_movers(Config(beams=beams(12.5, 12.5)))
    assert not told.bad
    assert "nobody is made way for" in told.sentence
    assert check_movers(Config(beams=beams(12.5, 3.0))) == ()
    assert check_movers(Config(beams=beams(12.5), movers=MoversConfig(watch=False))) == ()
    assert check_movers(Config()) == ()


def test_what_is_found_is_told_before_the_kernels_are_ready(tmp_path: Path) -> None:
    findings = check_machine(Config(), tmp_path)
    assert "configuration is valid" in next(findings).sentence
    assert "kernels were ready" in list(findings)[-1].sentence


def test_sensors_on_this_computer_are_looked_at_without_a_vehicle() -> None:
    assert check_local(Config()) == ()
    bus = {"driver": "i2c", "bus": "/dev/i2c-none", "sensors": [{"chip": "vl53l1x", "beam": "up"}]}
    both = BeamsConfig.model_validate({"drivers": [bus, {"driver": "mavlink"}]})
    gnss = SerialGnssConfig(driver="serial", port="/dev/ttyNone")
    found = check_local(Config(beams=both, gnss=gnss))
    assert all(finding.bad for finding in found)
    missing, up, receiver = (finding.sentence for finding in found)
    assert "/dev/i2c-none does not exist" in missing
    assert "beam up sends nothing" in up
    assert "/dev/ttyNone" in receiver


def test_python_and_packages_are_named() -> None:
    assert check_python().sentence.startswith("Python 3.")
    assert check_packages() == (
        Finding(good=True, sentence="all packages are there and new enough"),
    )


def test_a_place_where_no_log_can_be_written_is_told(tmp_path: Path) -> None:
    place = Path("/proc") / str(os.getpid()) / "flights"
    finding = check_disk(place)
    assert not finding.good
    assert "flight logs cannot be written there" in finding.sentence
    assert "--log-dir" in finding.sentence
    file = tmp_path / "file"
    file.write_text("")
    assert not check_disk(file).good


def readings(beam: str, count: int, status: RangeStatus = RangeStatus.VALID) -> list[RangeReading]:
    return [RangeReading(k / 20.0, beam, status, 0.5, 1e-4, 0.02, 1.0) for k in range(count)]


def test_each_beam_is_judged_by_itself() -> None:
    heard = [
        *readings("front", 60),
        *readings("right", 29),
        *readings("back", 60, RangeStatus.NO_SIGNAL),
        *readings("left", 60, RangeStatus.OUT_OF_RANGE),
        *readings("up", 30),
    ]
    findings = check_beams(Config(), heard, 3.0)
    assert [finding.good for finding in findings] == [True, False, False, True, True, False]
    assert "beam right comes at 9.7 Hz only; the loop runs at 20 Hz" in findings[1].sentence
    assert "beam back measures nothing" in findings[2].sentence
    assert "beam down sends nothing" in findings[5].sentence
