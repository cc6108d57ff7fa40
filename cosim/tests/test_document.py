"""A scenario file is either understood or refused with file, line, column and a sentence."""

from pathlib import Path

import pytest

from cosim.changes import set_value
from cosim.document import MAX_BYTES, read_document
from cosim.errors import InputError

EXAMPLE = Path(__file__).with_name("example.xml")


def refused(path: Path, *replacements: str) -> InputError:
    with pytest.raises(InputError) as caught:
        read_document(path, [set_value(replacement) for replacement in replacements])
    return caught.value


def variant(tmp_path: Path, old: str, new: str) -> Path:
    text = EXAMPLE.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "variant.xml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


def test_the_text_is_kept_as_it_is_read() -> None:
    assert read_document(EXAMPLE).text == EXAMPLE.read_text(encoding="utf-8")


def test_missing_file(tmp_path: Path) -> None:
    assert str(refused(tmp_path / "none.xml")) == f"{tmp_path / 'none.xml'}: there is no such file"


def test_folder(tmp_path: Path) -> None:
    assert "cannot be read: Is a directory" in str(refused(tmp_path))


def test_too_large(tmp_path: Path) -> None:
    path = tmp_path / "large.xml"
    path.write_bytes(b" " * (MAX_BYTES + 1))
    assert "larger than 4 MiB" in str(refused(path))


@pytest.mark.parametrize(
    ("content", "line", "column"),
    [(b"", 1, 1), (b"step: 3", 1, 1), (b"<scenario>\n  <plant></scenario>", 2, 12), (b"<a>\xff</a>", 1, 4)],
)
def test_not_xml(tmp_path: Path, content: bytes, line: int, column: int) -> None:
    path = tmp_path / "bad.xml"
    path.write_bytes(content)
    error = refused(path)
    assert "is not well-formed XML" in error.message
    assert (error.where.line, error.where.column) == (line, column)


def test_nested_without_end(tmp_path: Path) -> None:
    path = tmp_path / "deep.xml"
    path.write_text("<a>" * 300_000 + "</a>" * 300_000)
    error = refused(path)
    assert "nested more than 50 deep" in error.message
    assert error.where.column == 151


def test_another_root(tmp_path: Path) -> None:
    path = tmp_path / "other.xml"
    path.write_text("<svg/>")
    assert "the root element is svg; expected is <scenario xmlns='urn:formation-cosim:scenario:1'>" in str(
        refused(path)
    )


@pytest.mark.parametrize(
    "doctype",
    [
        '<!DOCTYPE scenario [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>',
        '<!DOCTYPE scenario [<!ENTITY secret SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE scenario SYSTEM "http://127.0.0.1:9/scenario.dtd">',
    ],
)
def test_document_types_are_refused(tmp_path: Path, doctype: str) -> None:
    path = variant(tmp_path, "<scenario ", doctype + "\n<scenario ")
    error = refused(path)
    assert "has no document type declaration" in error.message
    assert error.where.line == 2


@pytest.mark.parametrize(
    ("old", "new", "line", "column", "sentence"),
    [
        ('range="3 m"', 'range="3"', 49, 5, 'range="3" of <desired> is not a length with its unit (m, cm, mm or km)'),
        ('bearing="45 deg"', 'bearing="45 °"', 49, 5, 'bearing="45 °" of <desired> is not an angle with its unit'),
        ('step="20 ms"', 'step="20 ms" stepp="1 s"', 11, 3, "no attribute 'stepp': did you mean 'step'?"),
        ('bearing="45 deg"', "", 49, 5, "<desired> lacks the attribute 'bearing'"),
        ("<sensor>", "<sensors/><sensor>", 35, 3, "<sensors> is not expected here in <scenario>; expected: <con"),
        ('<desired range="3 m" bearing="45 deg"/>', "", 47, 3, "<follower> is incomplete; expected next: <desired>"),
        ("<actuator>", "<actuator>hello", 38, 3, "<actuator> must not contain text"),
        ('name="example"', 'name="../../escape"', 2, 1, 'name="../../escape" of <scenario> is not a name'),
        ('seed="1"', 'seed="one"', 11, 3, 'seed="one" of <simulation> is not a whole number from 0'),
    ],
)  # fmt: skip
def test_what_breaks_the_schema(tmp_path: Path, old: str, new: str, line: int, column: int, sentence: str) -> None:
    error = refused(variant(tmp_path, old, new))
    assert sentence in error.message
    assert (error.where.line, error.where.column) == (line, column)


def test_set_an_attribute() -> None:
    document = read_document(EXAMPLE, [set_value('//gain[@name="gamma_w"]/@value=0.1')])
    assert '<gain name="gamma_w" value="0.1"/>' in document.text
    assert "first simulation" in document.text


def test_set_a_text_and_a_value_with_equals_signs() -> None:
    document = read_document(EXAMPLE, [set_value("//title=a = b"), set_value("//controller/@version=>=0.1,<2")])
    assert "<title>a = b</title>" in document.text
    assert 'version="&gt;=0.1,&lt;2"' in document.text


@pytest.mark.parametrize(
    ("replacement", "sentence"),
    [
        ("//gain", "expected XPATH=VALUE"),
        ("//gain[@name='gamma_w", "expected XPATH=VALUE"),
        ("//gian/@value=1", "'//gian/@value' selects nothing"),
        ("//gain[1=]/@value=1", "is not an XPath"),
        ("//follower=1", "selects something other than an attribute or an element of text"),
        ("count(//gain)=1", "selects nothing"),
        ("//simulation/@horizon=soon", 'horizon="soon" of <simulation> is not a time with its unit'),
    ],
)
def test_bad_replacements(replacement: str, sentence: str) -> None:
    assert sentence in str(refused(EXAMPLE, replacement))
