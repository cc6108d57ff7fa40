"""A study of an FMU that crashes at a time that varies."""

from pathlib import Path

from cosim.studies.reader import read_study
from cosim.studies.study import Study
from cosim.tests.driving import scenario
from cosim.tests.studies import write_study

from .stub.stub import make_fmu


def crashing_study(folder: Path, times: str) -> Study:
    """Write a study of 0.4 s, with a run for each time at which the FMU crashes, and read it."""
    make_fmu(folder, name="car", behaviour="segfault", when=9)
    vary = f'<vary name="when" select="plant/parameter/@value"><list values="{times}"/></vary>'
    path = write_study(folder, vary, '<sample method="grid"/>')
    plant = '<plant id="car" fmu="car.fmu"><parameter name="when" value="9 s"/></plant>'
    scenario(folder / "base.xml", plant, followers=["car"], horizon="0.4 s")
    return read_study(path)
