"""Tables are read with their units, and refused with their line and the place that asks for them."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError, Location
from cosim.scenario import csv_table
from cosim.scenario.csv_table import Table, read_table
from plants import units

WHERE = Location("scenario.xml", 12, 5)


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "wind.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(folder: Path, text: str | bytes) -> Table:
    return read_table(written(folder, text), WHERE)


def test_columns_come_in_the_units_asked_for(tmp_path: Path) -> None:
    found = read(tmp_path, "x [km],time [ms],n,part [1],psi [deg]\n1,0,3,0.5,180\n-2.5e-1,20,4,+.5,-90\n")
    assert found.time.tolist() == [0.0, 0.02]
    assert found.column("x", "m", WHERE).tolist() == [1000.0, -250.0]
    assert found.column("x", "km", WHERE).tolist() == [1.0, -0.25]
    assert found.column("n", "1", WHERE).tolist() == [3.0, 4.0]
    assert found.column("part", "%", WHERE).tolist() == [50.0, 50.0]
    assert found.column("psi", units.parse("rad"), WHERE) == pytest.approx([math.pi, -math.pi / 2])
    assert found.column("time", "min", WHERE) == pytest.approx([0.0, 0.02 / 60])


@pytest.mark.parametrize(
    "text",
    [
        b"\xef\xbb\xbftime [s],wind [N]\r\n0,1\r\n1,2\r\n",
        "time [s],wind [N]\r0,1\r1,2",
        '"time [s]","wind [N]"\n"0","1"\n"1","2"\n',
        " time[s] ,  wind  [ N ]\n 0 , 1\n\n\t1,2  \n\n",
    ],
    ids=["byte order mark and line ends of Windows", "no last line end", "quoted", "spaces and empty lines"],
)
def test_what_spreadsheets_write(tmp_path: Path, text: str | bytes) -> None:
    found = read(tmp_path, text)
    assert found.time.tolist() == [0.0, 1.0]
    assert found.column("wind", "N", WHERE).tolist() == [1.0, 2.0]


def test_one_row_is_a_table(tmp_path: Path) -> None:
    assert read(tmp_path, "time [s],wind [N]\n5,7\n").column("wind", "N", WHERE).tolist() == [7.0]


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "no column 'time [s]'"),
        ("t [s],x [m]\n0,1\n", 1, "no column 'time [s]'"),
        ("time [s];x [m]\n0;1\n", 1, "the first line has no commas"),
        ("time [s],x [m]\n", 1, "no rows"),
        ("time [s],x [m]\n\n\n", 1, "no rows"),
        ("time [m],x [m]\n0,1\n", 1, "'time' is in m, but expected a unit such as s"),
        ("time,x [m]\n0,1\n", 1, "the column 'time' has no unit: name it 'time [s]' in the first line"),
        ("time (s),x [m]\n0,1\n", 1, "no column 'time [s]', but 'time (s)', 'x'"),
        ("time [sec],x [m]\n0,1\n", 1, "unit 'sec': write 's'"),
        ("time [s],x [m],x [km]\n0,1,2\n", 1, "two columns are named 'x'"),
        ("time [s],[m]\n0,1\n", 1, "column 2 is named '[m]'"),
        ("time [s],x [m\n0,1\n", 1, "column 2 is named 'x [m'"),
        ("time [s],x []\n0,1\n", 1, "column 2 is named 'x []'"),
        ("time [s],x [m],\n0,1,\n", 1, "column 3 is named ''"),
        ("time [s],x [m]\n0,1\n1,2,3\n", 3, "the row has 3 cells, but the first line names 2"),
        ("time [s],x [m]\n0,1,2\n1,2,3\n", 2, "the row has 3 cells, but the first line names 2"),
        ("time [s],x [m]\n0,1\n1\n", 3, "the row has 1 cell, but the first line names 2"),
        ("time [s],x [m]\n\n0,1\n\n1,\n", 5, "'' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,1\n1,two\n", 3, "'two' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,1\n1,1_000\n", 3, "'1_000' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,1\n1,\u2028\x1c9\x1c\n2,two\n", 3, "in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,1\n1,٢\n", 3, "'٢' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,0,1,5\n", 2, "the row has 4 cells, but the first line names 2 (decimals follow a point)"),
        (
            'time [s],x [m]\n0,"1,5"\n',
            2,
            "'1,5' in the column 'x' is not a finite number: write '1.5' (decimals follow",
        ),
        ("time [s],x [m]\n0,−1\n", 2, "'−1' in the column 'x' is not a finite number: write '-1' (a minus sign is"),
        ("time [s],x [m]\n0,nan\n", 2, "'nan' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,-inf\n", 2, "'-inf' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,1e999\n", 2, "'1e999' in the column 'x' is not a finite number"),
        ("time [s],x [m]\n0,1\n2,1\n2,1\n", 4, "the time 2 is not later than 2 before it"),
        ("time [s],x [m]\n0,1\n\n-1,1\n", 4, "the time -1 is not later than 0 before it"),
        ('time [s],x [m]\n0,"1\n1,2\n', 3, "is not a finite number"),
        (b"time [s],x [m]\n0,1\n1,\xb5\n", 3, "is not text in UTF-8"),
        (b"time [s],x [m]\n0,1\n1,\x00\n", 3, "is not a finite number"),
    ],
)
def test_wrong_tables(tmp_path: Path, text: str | bytes, line: int, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert message in caught.value.message
    assert str(WHERE) in caught.value.message
    assert caught.value.where == Location(str(tmp_path / "wind.csv"), line)


def test_a_long_text_is_shown_in_part(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, f"time [s],x [m]\n0,{'x' * 100_000}\n")
    assert len(str(caught.value)) < 500
    with pytest.raises(InputError, match="not a table of comma-separated values"):
        read(tmp_path, f'time [s],"x [m]\n{"0,1" * 100_000}\n')


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("wimd", "N", "has no column 'wimd': did you mean 'wind'?"),
        ("wind", "m", "the column 'wind' is in N, but expected a unit such as m"),
        ("bare", "m", "the column 'bare' has no unit: name it 'bare [m]' in the first line"),
        ("odd", "m", "'furlong' is not known"),
        ("huge", "nm", "too large"),
    ],
)
def test_wrong_columns(tmp_path: Path, name: str, unit: str, message: str) -> None:
    found = read(tmp_path, "time [s],wind [N],bare,odd [furlong],huge [Gm]\n0,1,2,3,1e305\n")
    with pytest.raises(InputError) as caught:
        found.column(name, unit, WHERE)
    assert message in caught.value.message
    assert str(WHERE) in str(caught.value)
    assert found.path.name in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    for name, message in (("none.csv", "no such file"), ("pipe.csv", "regular file"), (".", "regular file")):
        with pytest.raises(InputError, match=message) as caught:
            read_table(tmp_path / name, WHERE)
        assert str(WHERE) in caught.value.message
    path = written(tmp_path, "time [s],x [m]\n0,1\n1,2\n")
    assert len(read_table(path, WHERE).time) == 2
    monkeypatch.setattr(csv_table, "MAX_CELLS", 5)
    with pytest.raises(InputError, match="6 cells, more than 5"):
        read_table(path, WHERE)
    monkeypatch.setattr(csv_table, "MAX_BYTES", 5)
    with pytest.raises(InputError, match="is larger than"):
        read_table(path, WHERE)


def test_every_number_is_kept_to_its_last_digit(tmp_path: Path) -> None:
    values = np.random.default_rng(1).standard_normal((500, 2))
    values[:, 0] = np.cumsum(np.abs(values[:, 0]))
    found = read(tmp_path, "time [s],x [m]\n" + "".join(f"{t!r},{x!r}\n" for t, x in values.tolist()))
    assert np.array_equal(np.column_stack([found.time, found.column("x", "m", WHERE)]), values)
