"""A file that is not there: with the one that is perhaps meant."""

import os
from pathlib import Path

import pytest

from cosim.errors import InputError, Location
from cosim.fmu.package import open_package
from cosim.missing_file import absent
from cosim.scenario.csv_table import read_table
from cosim.scenario.document import read_document


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("wind.xml", ""),
        ("line.xm", ""),
        ("LINE.xml", ": did you mean {folder}/line.xml?"),
        ("lime.xml", ": did you mean {folder}/line.xml?"),
        ("line", ": did you mean {folder}/line.xml?"),
        ("none/line.xml", ", nor a folder {folder}/none"),
        ("file:///tmp/a%20line.xml", ": write the path without file://, as in /tmp/a line.xml"),
        ("..\\scenarios\\line.xml", ": write the path with / instead of \\, as in ../scenarios/line.xml"),
    ],
)
@pytest.mark.skipif(os.sep != "/", reason="on Windows, a path is written with \\\\")
def test_what_is_meant(tmp_path: Path, name: str, hint: str) -> None:
    (tmp_path / "line.xml").touch()
    assert absent(tmp_path / name) == "there is no such file" + hint.format(folder=tmp_path)


def test_everyone_who_reads_files_says_so(tmp_path: Path) -> None:
    for name in ("line.xml", "line.fmu", "line.csv"):
        (tmp_path / name).touch()
    for read, name in (
        (read_document, "line.xml"),
        (open_package, "line.fmu"),
        (lambda path: read_table(path, Location("scenario.xml")), "line.csv"),
    ):
        with pytest.raises(InputError, match=f"there is no such file: did you mean .*{name}"):
            read(tmp_path / name.replace("line", "lime"))
