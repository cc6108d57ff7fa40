"""Breaches of a schema in large files, and large files that are no XML: refused as small ones are."""

from pathlib import Path
from threading import active_count

import pytest
from lxml import etree

from cosim.fmu.breaches import MOST, OPTIONS, Breaches
from cosim.fmu.description import PARSER, _schema

VARIABLES = 12_000


def described(variable: str = '<Real start="1.0"/>', end: str = "") -> bytes:
    """Return a description of more tags than a small file has."""
    variables = "\n".join(
        f'<ScalarVariable name="p{i}" valueReference="{i}" causality="parameter" variability="fixed">{variable}'
        "</ScalarVariable>"
        for i in range(VARIABLES)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1">\n'
        '<CoSimulation modelIdentifier="m"/>\n'
        f"<ModelVariables>\n{variables}\n</ModelVariables>\n<ModelStructure/>\n</fmiModelDescription>{end}"
    ).encode()


def read(folder: Path, data: bytes) -> tuple[int, list[str]]:
    path = folder / "modelDescription.xml"
    path.write_bytes(data)
    with Breaches(data, _schema("2")) as breaches:
        root = etree.parse(path, PARSER).getroot()
        return len(root.findall("ModelVariables/ScalarVariable")), breaches.of(root)


def test_a_whole_file(tmp_path: Path) -> None:
    assert read(tmp_path, described()) == (VARIABLES, [])


WHOLE = described()
NO_XML = {
    "half of it": WHOLE[: len(WHOLE) // 2],
    "without its end": WHOLE[:-22],
    "without its last sign": WHOLE[:-1],
    "cut at the end of an element": WHOLE[: WHOLE.index(b"</ScalarVariable>", len(WHOLE) // 2) + 17],
    "cut before its first variable": WHOLE[:140] + b"<" * 30_000,
    "with a tag that is not closed": WHOLE.replace(
        b'</ScalarVariable>\n<ScalarVariable name="p9000"', b'\n<ScalarVariable name="p9000"'
    ),
    "with another end": WHOLE.replace(b"</ModelVariables>", b"</ModelVariable>"),
    "with a sign that no XML has": WHOLE.replace(b'"p7000"', b'"p\x017000"'),
    "with bytes that are not its encoding": WHOLE.replace(b'"p7000"', b'"p\xff7000"'),
    "with a second root": described(end="<a/>"),
    "with text behind it": described(end="text"),
    "with an entity that nobody defines": WHOLE.replace(b'"p7000"', b'"&p7000;"'),
    "with an attribute twice": WHOLE.replace(b'name="p7000"', b'name="p7000" name="p"'),
}


@pytest.mark.parametrize("data", NO_XML.values(), ids=NO_XML.keys())
def test_what_is_no_xml(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(etree.XMLSyntaxError):
        etree.fromstring(data, etree.XMLParser(**OPTIONS))
    with pytest.raises((etree.XMLSyntaxError, OSError), match=r"modelDescription\.xml"):
        read(tmp_path, data)


def test_few_and_many_breaches(tmp_path: Path) -> None:
    number, breaches = read(tmp_path, WHOLE.replace(b'<ScalarVariable name="p7000"', b'<ScalarVariable nam="p7000"'))
    assert number == VARIABLES
    assert [breach.split(":")[0] for breach in breaches] == ["line 7005", "line 7005"]
    number, breaches = read(tmp_path, described("<Rael/>"))
    assert number == VARIABLES
    assert MOST <= len(breaches) < 2 * MOST


def test_the_thread_ends_with_the_context() -> None:
    before = active_count()
    for data in (WHOLE, WHOLE[: len(WHOLE) // 2], described("<Rael/>")):
        with pytest.raises(KeyboardInterrupt), Breaches(data, _schema("2")):
            raise KeyboardInterrupt
        assert active_count() == before, "a process that is forked now would have a broken copy of it"
