"""A plain sentence for everything that is wrong before flying."""

import os
from pathlib import Path

from autonomy.config import Config
from autonomy.doctor import check_disk, check_machine, check_packages, check_python
from autonomy.finding import Finding
from autonomy.vehicle_check import check_beams
from hal.readings import RangeReading, RangeStatus


def test_this_machine_is_fit_to_run_its_own_tests(tmp_path: Path) -> None:
    findings = check_machine(Config(), tmp_path / "not" / "yet" / "there")
    assert [str(finding) for finding in findings if not finding.good] == []
    assert not (tmp_path / "not").exists()


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
