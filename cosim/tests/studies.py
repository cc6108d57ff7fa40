"""Small studies for tests: their file, and an executor in this process."""

from pathlib import Path

from cosim.scenario.grammar import NAMESPACE
from cosim.studies.reader import read_study
from cosim.studies.study import Study

EXAMPLE = Path(__file__).with_name("example.xml")
MASS = "plant/parameter[@name='m_c']/@value"
UNIFORM = f'<vary name="mass" select="{MASS}"><uniform from="25 kg" to="40000 g"/></vary>'
SEEDS = '<vary name="seed" select="simulation/@seed"><count from="7"/></vary>'
LAST = '<measure name="last" figure="final" signal="range_error" unit="mm"/>'


def write_study(
    folder: Path, vary: str = UNIFORM + SEEDS, sample: str = '<sample method="random" runs="6"/>', rest: str = LAST
) -> Path:
    """Write a study of a scenario of ten ticks, which passes."""
    base = EXAMPLE.read_text(encoding="utf-8").replace('"100 s"', '"0.2 s"')
    expect = '<expect><final signal="range_error" below="99 m"/></expect></scenario>'
    (folder / "base.xml").write_text(base.replace("</scenario>", expect), encoding="utf-8")
    path = folder / "study.xml"
    path.write_text(
        f'<study xmlns="{NAMESPACE}" name="small" of="base.xml">\n<title>A small study</title>\n'
        f"{vary}\n{sample}\n{rest}\n</study>\n",
        encoding="utf-8",
    )
    return path


def small_study(folder: Path, *parts: str, **named: str) -> Study:
    """Write a study and read it; see `write_study`."""
    return read_study(write_study(folder, *parts, **named))
