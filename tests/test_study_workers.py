"""Every kind of study by this process and by four others: bit for bit the same store and files."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cosim.studies import elsewhere, engine
from cosim.studies.conduct import conduct
from cosim.studies.reader import read_study
from cosim.studies.store import FILE
from cosim.studies.summary import as_json
from cosim.studies.table import as_csv
from cosim.tests.studies import LAST, SEEDS, UNIFORM, write_study

GAIN = """<vary name="K_p" select="//gain[@name='K_p']/@value"><log_uniform from="0.1" to="1000"/></vary>"""
KINDS = {
    "draws": '<sample method="sobol" runs="24"/>',
    "tuning": '<tune values="mass K_p" evaluations="8" batch="4" training="1 2" held_out="11 to 13" confidence="0.5">'
    '<cost of="last" per="10 mm"/></tune>',
    "search": '<search runs="24" batch="6"/>',
    "sensitivity": '<sample method="saltelli" runs="40"/>',
}


@pytest.fixture(scope="module")
def four() -> Iterator[ThreadPoolExecutor]:
    """Return an executor whose threads have a process each, which is kept from study to study."""
    with ThreadPoolExecutor(4) as executor:
        yield executor
    elsewhere._processes().close()
    elsewhere._processes.cache_clear()


@pytest.mark.parametrize("kind", KINDS)
def test_one_process_or_four(
    tmp_path: Path, kind: str, four: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "_LARGEST", 3)  # runs of a chunk, so that all four have some
    study = read_study(write_study(tmp_path, UNIFORM + GAIN + SEEDS, KINDS[kind], LAST))
    files = []
    for name, own in (("here", {"workers": 0}), ("there", {"workers": 4, "executor": four})):
        (tmp_path / name).mkdir()
        outcome = conduct(study, tmp_path / name, **own)
        rows = sorted((tmp_path / name / FILE).read_bytes().splitlines())
        files.append((rows, as_csv(outcome), as_json(outcome)))
        assert len(rows) == len(outcome.rows) + 1 == outcome.made + 1
    assert files[0] == files[1]
