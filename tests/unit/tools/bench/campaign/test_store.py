"""What was flown is kept, whatever happens to who flew it."""

import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.errors import BadInput
from tests.unit.tools.bench.campaign.made import row
from tools.bench.campaign.store import Store, read_part, rows_of

ROWS = [row(f"room:{number}", seed) for number in (10, 2) for seed in range(3)]


def flown_into(folder: Path, part_rows: int = 1000) -> None:
    with Store(folder, part_rows=part_rows) as store:
        assert store.kept() == []
        for each in ROWS:
            store.keep(each)


@pytest.mark.parametrize("part_rows", [1, 4, 100])
def test_rows_come_back_as_they_were_world_by_world(tmp_path: Path, part_rows: int) -> None:
    flown_into(tmp_path, part_rows)
    assert [each.world for each in rows_of(tmp_path)] == ["room:2"] * 3 + ["room:10"] * 3
    assert set(rows_of(tmp_path)) == set(ROWS)
    assert not (tmp_path / "newest.jsonl").exists()


def test_none_and_every_kind_of_column_survive(tmp_path: Path) -> None:
    odd = row("file:a,b.yaml", clearance_m=None, optimum_m=None, collided=True, stops=3, why="é|")
    with Store(tmp_path) as store:
        store.keep(odd)
    assert rows_of(tmp_path) == [odd]


@settings(deadline=None, max_examples=12)
@given(killed_after=st.integers(0, 6), torn=st.booleans())
def test_killed_anywhere_nothing_is_lost_but_the_row_in_flight(
    tmp_path_factory: pytest.TempPathFactory, killed_after: int, torn: bool
) -> None:
    folder = tmp_path_factory.mktemp("campaign")
    store = Store(folder, part_rows=4)
    store.__enter__()
    for each in ROWS[:killed_after]:
        store.keep(each)
    assert store._lock is not None
    store._lock.close()  # as the kernel does for a killed process; nothing is sealed
    if torn:
        with (folder / "newest.jsonl").open("ab") as file:
            file.write(b'{"planner": "t3dr')
    with Store(folder, part_rows=4) as again:
        kept = again.kept()
        assert set(kept) == set(ROWS[:killed_after])
        for each in ROWS:
            if each not in kept:
                again.keep(each)
    assert len(rows_of(folder)) == len(ROWS)
    assert sum(len(read_part(path)) for path in (folder / "rows").iterdir()) == len(ROWS)


def test_killed_between_sealing_and_forgetting_no_row_counts_twice(tmp_path: Path) -> None:
    flown_into(tmp_path)
    (part,) = (tmp_path / "rows").iterdir()
    with Store(tmp_path / "other") as store:
        for each in ROWS:
            store.keep(each)
        lines = (tmp_path / "other" / "newest.jsonl").read_bytes()
    (tmp_path / "newest.jsonl").write_bytes(lines)
    with Store(tmp_path) as again:
        assert len(again.kept()) == len(ROWS)
    assert list((tmp_path / "rows").iterdir()) == [part]


def test_a_torn_part_is_set_aside_and_its_flights_are_missing_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown_into(tmp_path, part_rows=3)
    torn = tmp_path / "rows" / "part-00000.parquet"
    torn.write_bytes(torn.read_bytes()[:-9])
    with Store(tmp_path) as store:
        assert set(store.kept()) == set(ROWS[3:])
        for each in ROWS[:3]:
            store.keep(each)
    assert "set aside" in capsys.readouterr().err
    assert (tmp_path / "part-00000.parquet.torn").exists()
    assert set(rows_of(tmp_path)) == set(ROWS)


def test_a_campaign_in_flight_can_be_read_beside(tmp_path: Path) -> None:
    with Store(tmp_path, part_rows=4) as store:
        for each in ROWS:
            store.keep(each)
        assert len(rows_of(tmp_path)) == len(ROWS)
        with pytest.raises(BadInput, match="being flown into by another process"):
            Store(tmp_path).__enter__()


def test_what_is_sealed_while_it_is_read_is_not_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Store(tmp_path) as store:
        for each in ROWS:
            store.keep(each)
        read = Path.read_bytes

        def sealed_behind_it(path: Path) -> bytes:
            told = read(path)
            if path.name == "newest.jsonl":
                store.seal()
            return told

        monkeypatch.setattr(Path, "read_bytes", sealed_behind_it)
        assert set(rows_of(tmp_path)) == set(ROWS)
        assert not (tmp_path / "newest.jsonl").exists()


def test_without_pyarrow_nothing_is_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(BadInput, match=r"autonomy\[campaign\]"):
        Store(tmp_path).__enter__()


def test_a_folder_without_rows_and_lines_that_are_none_are_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="holds no rows of a campaign"):
        rows_of(tmp_path)
    (tmp_path / "newest.jsonl").write_text('{"other": 1}\n')
    with pytest.raises(BadInput, match="is of another version"):
        rows_of(tmp_path)
    with Store(tmp_path) as store, pytest.raises(BadInput, match="line 1 is no row"):
        store.kept()
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        Store(tmp_path / "file").__enter__()
