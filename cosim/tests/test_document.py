"""A scenario file is either understood or refused with file, line, column and a sentence."""

import os
import re
import sys
import tracemalloc
import zipfile
from contextlib import ExitStack
from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.scenario import xml_tree
from cosim.scenario.document import MAX_BYTES, read_binding_document, read_document
from cosim.scenario.edits import set_value
from cosim.scenario.reader import read_scenario

EXAMPLE = Path(__file__).with_name("example.xml")
COMPARE = '<compare measure="mean" signal="range_error" factor="1" scenario="other.xml"/>'


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
    ("more", "sentence"),
    [
        ("<a/>" * 300_000, "has more than 40000 elements"),
        (
            "<pose " + " ".join(f'a{i}="1 m"' for i in range(40_000)) + "/>",
            "has 40000 attributes; at most 100 are read",
        ),
    ],
)
def test_many_parts(tmp_path: Path, more: str, sentence: str) -> None:
    assert sentence in str(refused(variant(tmp_path, "<sensor>", f"{more}<sensor>")))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_too_many_elements_are_told_where_they_begin(encoding: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml_tree, "MAX_ELEMENTS", 3)
    monkeypatch.setattr(xml_tree, "MAX_DEPTH", 2)

    def fault(text: str) -> str:
        try:
            return str(len(xml_tree.parsed(text.encode(encoding), Path("f"))[1]))
        except InputError as error:
            return str(error)

    assert fault("<a>\n<b/>\n <b></b><b/></a>").startswith("f:3:9: has more than 3 elements")
    assert fault("<a><!-- <b/><b/><b/><b/> --><b/><b/></a>") == "3"
    assert fault("<a>\n<b><c/></b><b/><b/></a>").startswith("f:2:4: elements are nested more than 2 deep")
    assert "document type" in fault("<!DOCTYPE a><a><b/><b/><b/></a>")
    assert fault("<a>\n<b/></c><b/><b/></a>").startswith("f:2:7: is not well-formed XML")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1", "koi8-r"])
def test_around_the_root_element_nothing_counts(tmp_path: Path, encoding: str) -> None:
    """Comments before and after it, instructions, a byte order mark, an encoding that few programs know."""
    text = EXAMPLE.read_text("utf-8")
    around = text.replace("?>", "?>\n<!-- before > --><?a b?>\n", 1).replace(
        'encoding="UTF-8"', f'encoding="{encoding}"'
    )
    (path := tmp_path / "case.xml").write_bytes(f"{around}<!-- after --><?c d?>\n".encode(encoding))
    document, plain = read_document(path, [set_value("//simulation/@seed=3")]), read_document(EXAMPLE)
    assert [place.line for place in document.places] == [place.line + 2 for place in plain.places]
    assert read_scenario(path).followers[1].id == "follower_2"
    assert "before" not in document.text


def test_an_element_of_the_language_under_a_prefix(tmp_path: Path) -> None:
    text = EXAMPLE.read_text("utf-8").replace("xmlns=", "xmlns:f=").replace("</", "</f:")
    (path := tmp_path / "case.xml").write_text(re.sub("<(?=[a-z])", "<f:", text))
    assert read_scenario(path, ["//simulation/@seed=3"]).seed == 3


@pytest.mark.parametrize(
    "bad", ["<event/>", '<event at="1 s" robots="leader"><stop/><stop a="1"/></event>', '<event x="">1</event>']
)
def test_the_first_of_many_breaches_is_found_soon(tmp_path: Path, bad: str) -> None:
    """The place of each takes libxml2 the longer the more are before it: all of them, their square."""
    good = '<event at="1 s" robots="leader"><stop/></event>\n' * 3000
    error = refused(variant(tmp_path, "</scenario>", f"{good}{bad * 10_000}</scenario>"))
    few = refused(variant(tmp_path, "</scenario>", f"{bad}</scenario>"))
    assert error.message == few.message
    assert error.where is not None
    assert few.where is not None
    assert error.where.line == few.where.line + 3000


def test_events_are_counted_for_each_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim.scenario.reader.MAX_EVENTS", 10)
    event = '<event at="1 s" robots="leader follower_1 follower_2 follower_2"><stop/></event>\n'
    assert len(read_scenario(variant(tmp_path, "</scenario>", event * 3 + "</scenario>")).events) == 9
    path = variant(tmp_path, "</scenario>", event * 5 + "</scenario>")
    with pytest.raises(InputError, match="up to here there are 12 events, each counted once for each robot") as caught:
        read_scenario(path)
    line = path.read_text(encoding="utf-8").splitlines().index(event.strip()) + 1
    assert caught.value.where is not None
    assert caught.value.where.line in (line + 3, line + 4)


def test_white_space_in_values_is_read_alike_in_files_and_changes(tmp_path: Path) -> None:
    path = variant(tmp_path, 'x="-5 m" y="0 m"', 'x=" -5 \n m " y="0\tm"')
    (x, y), *_ = [
        (pose.get("x"), pose.get("y")) for pose in read_document(path).root.iter("{*}follower") for pose in [pose[0]]
    ]
    assert (x, y) == ("-5 m", "0 m")
    changed = read_document(path, [set_value("follower[1]/pose/@x=  -6   m ")])
    assert [pose.get("x") for pose in changed.root.iter("{*}pose")][1] == "-6 m"


def test_a_file_of_100_mb_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.xml"
    with path.open("wb") as file:
        file.truncate(100_000_000)
    tracemalloc.start()
    try:
        assert str(refused(path)) == f"{path}: is larger than 4 MiB, so it is no scenario file"
        assert tracemalloc.get_traced_memory()[1] < MAX_BYTES
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["x" * 5000 + ".xml", "file.xml/s.xml"])
def test_a_path_that_cannot_be(tmp_path: Path, name: str) -> None:
    (tmp_path / "file.xml").touch()
    assert ": cannot be read: " in str(refused(tmp_path / name))


@pytest.mark.skipif(sys.platform == "win32", reason="needs a named pipe")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xml")
    assert str(refused(tmp_path / "pipe.xml")).endswith("pipe.xml: is not a regular file")


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


@pytest.mark.parametrize(
    ("content", "line", "column", "sentence"),
    [
        (
            "<a>Größe</a>".encode("latin-1"),
            1,
            6,
            "the file seems to be in Latin-1, where it is 'ö': save it in UTF-8, or",
        ),
        ("<a>“Größe”</a>".encode("cp1252"), 1, 4, "in Windows-1252, where it is '“': save it in UTF-8, or declare it"),
        (b"<a>\x81</a>", 1, 4, "the byte 0x81 is no text in UTF-8: save the file in that encoding"),
        ("<?xml version='1.0' encoding='utf-8'?><a/>".encode("utf-16"), 1, 32, "not in the encoding that it declares"),
        (b"<a>Sturm & Drang</a>", 1, 11, "write &amp; for the character itself"),
        (b"<a>1&nbsp;m</a>", 1, 5, "&nbsp; is not known: XML has only &amp; &lt; &gt; &quot; and &apos;"),
        (b"<a>x < 1</a>", 1, 7, "write &lt; for the character itself"),
        (b"<a v='<1'/>", 1, 7, "write &lt; for a < in a value"),
        (b"<a>\n  <b>\n  <c/>\n</a>", 4, 3, "</b> is missing before </a>: <b> of line 2 is not closed"),
        (b"<a>\n  <b>x</d>\n</a>", 2, 9, "</d> closes nothing; expected </b>, for <b> of line 2"),
        (b"<a>\n  <b>", 2, 6, "it ends, but <b> of line 2 is not closed: </b> is missing"),
        (b"<a>\n<b", 2, 1, "the > of this tag, or a closing quote in it, is missing"),
        (b"<a>\n<!-- ", 2, 1, "the --> of this comment is missing"),
        (b"<a><!-- x -- y --></a>", 1, 13, "a comment cannot have -- in it"),
        (b"<a x='1 m y='2 m'/>", 1, 14, "the value of 'x' lacks its closing quote"),
        (b"<a>\n<b x='1 m/>\n<c/></a>", 3, 1, "a closing quote is missing in the tag that begins in line 2"),
        ("<a x=“1 m”/>".encode(), 1, 6, "a value stands in straight quotes"),
        (b"<a x='1'y='2'/>", 1, 9, "a space is missing between two attributes"),
        (b"<a x/>", 1, 5, "the attribute 'x' has no value"),
        (b"<a x='1' x='2'/>", 1, 10, "the attribute 'x' is given twice"),
        (b"<a/>\n<a/>", 2, 1, "nothing may follow the end of the root element"),
        (b"\n<?xml version='1.0'?><a/>", 2, 1, "must be the very beginning of the file"),
        (b"<?xml encoding='utf-8'?>\n<a/>", 1, 7, 'write <?xml version="1.0" encoding="UTF-8"?>'),
        (b"<a>\x07</a>", 1, 4, "the control character 0x07 cannot be in an XML file"),
        (b"", 1, 1, "it is empty"),
    ],
)
def test_why_it_is_not_xml(tmp_path: Path, content: bytes, line: int, column: int, sentence: str) -> None:
    path = tmp_path / "bad.xml"
    path.write_bytes(content)
    error = refused(path)
    assert error.message.startswith("is not well-formed XML: ")
    assert sentence in error.message
    assert (error.where.line, error.where.column) == (line, column)


def test_a_declared_encoding_is_read(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace("UTF-8", "ISO-8859-1").replace("An example", "Größe")
    path = tmp_path / "latin.xml"
    path.write_bytes(text.encode("latin-1"))
    assert "<title>Größe" in read_document(path).text


def test_a_namespace_that_is_no_uri(tmp_path: Path) -> None:
    path = variant(tmp_path, "<sensor>", "<sensor xmlns='urn>a'>")
    assert refused(path).message == "the element {urn>a}sensor is not part of the scenario language"


def test_nested_without_end(tmp_path: Path) -> None:
    path = tmp_path / "deep.xml"
    path.write_text("<a>" * 300_000 + "</a>" * 300_000)
    error = refused(path)
    assert "nested more than 50 deep" in error.message
    assert error.where.column == 151


def test_another_root(tmp_path: Path) -> None:
    path = tmp_path / "other.xml"
    path.write_text("<svg/>")
    assert "the root element is svg; expected <scenario xmlns='urn:formation-cosim:scenario:1'>" in str(refused(path))


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
        ('range="3 m"', 'range="3"', 49, 5, 'range="3" of <desired> is not a length with its unit (m, '),
        ('bearing="45 deg"', 'bearing="45 °"', 49, 5, 'bearing="45 °" of <desired> is not an angle with its unit'),
        ('step="20 ms"', 'step="20 ms" stepp="1 s"', 11, 3, "no attribute 'stepp': did you mean 'step'?"),
        ('bearing="45 deg"', "", 49, 5, "<desired> lacks the attribute 'bearing'"),
        ("<sensor>", "<sensors/><sensor>", 35, 3, "<sensors> is not expected here in <scenario>; expected: <con"),
        ('<desired range="3 m" bearing="45 deg"/>', "", 47, 3, "<follower> is incomplete; expected next: <desired>"),
        ("<actuator>", "<actuator>hello", 38, 3, "<actuator> must not contain text"),
        ('name="example"', 'name="../../escape"', 2, 1, 'name="../../escape" of <scenario> is not a name'),
        ('seed="1"', 'seed="one"', 11, 3, 'seed="one" of <simulation> is not a whole number from 0'),
        ('seed="1"', 'seed="9223372036854775808"', 11, 3, "is not a whole number from 0 to 2^63 - 1"),
        ('x="1 mm"', 'x="1 kg"', 36, 5, 'x="1 kg" of <noise> is not a length with its unit'),
        ("<sensor>", '<sensor f:x="1" xmlns:f="urn:f">', 35, 3, "<sensor> has no attribute '{urn:f}x': known: none"),
        ('range="3 m"', 'range="3,5 m"', 49, 5, "or km), such as 3 m: write '3.5 m' (decimals follow a point)"),
        ('bearing="45 deg"', 'bearing="−45°"', 49, 5, "such as 45 deg: write '-45 deg' (a minus sign is a hyphen)"),
        ('value="0.05"', 'value="0,5"', 26, 5, "spaces between them: write '0.5' (decimals follow a point)"),
        ('range="3 m"', 'range="45°"', 49, 5, 'range="45°" of <desired> is not a length with its unit (m, '),
        ("</scenario>", f"<expect>{COMPARE}</expect></scenario>", 64, 9, 'measure="mean" of <compare> is not rms'),
        ("</scenario>", "<expect/></scenario>", 64, 1, "<expect> is incomplete; expected next: <settled> or <rms>"),
        ("</scenario>", "<leader/></scenario>", 64, 1, "<leader> is not expected here in <scenario>; expected: <fol"),
        ("An example for the tests", "", 4, 3, "the text '' of <title> is not a text that is not empty"),
        ("An example for", "<b/>", 4, 3, "<title> must not contain elements"),
        ('<saturation limit="200 N.m"/>', '<delay time="1 s"><x/></delay>', 39, 5, "<delay> must not contain elements"),
        ('<saturation limit="200 N.m"/>', '<delay time="1 s">x</delay>', 39, 5, "<delay> must not contain text"),
        ("<sensor>", '<x xmlns="urn:x"/><sensor>', 35, 3, "the element {urn:x}x is not part of the scenario"),
        ('name="example"', f'name="{"x" * 101}"', 2, 1, "at most 100"),
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
        ("gamma_w=1", "selects nothing in the scenario: did you mean //gain[@name='gamma_w']/@value?"),
        ("m_c=40 kg", "did you mean //parameter[@name='m_c']/@value?"),
        ("seed=2", "did you mean //simulation/@seed?"),
        ("@seed=2", "did you mean //simulation/@seed?"),
        ("//gain[@name=gamma_w]/@value=1", "did you mean //gain[@name='gamma_w']/@value?"),
        ("//gain[@name='gama_w']/@value=1", "did you mean //gain[@name='gamma_w']/@value?"),
        ("gain[@name='gamma_w']/@value=1", "did you mean //gain[@name='gamma_w']/@value?"),
        ("//gian/value=1", "did you mean //gain/@value?"),
        ("/simulation/@sed=1", "did you mean //simulation/@seed?"),
        (
            "//gain[@name='gamma_w']=1",
            "selects a <gain>, which has no text: an attribute of it ends in /@name or /@value",
        ),
        (
            "//gain[@name='gamma_w'/@value=1",
            "expected XPATH=VALUE, such as '//simulation/@seed=2'; the [ at character 7 has",
        ),
        ("//gain[@name='gamma_w]/@value=1", "the ' at character 14 has no ' that closes it"),
        ("//gain]/@value=1", "the ] at character 7 closes nothing"),
        ("//simulation/@horizon=soon", 'horizon="soon" of <simulation> is not a time with its unit'),
    ],
)
def test_bad_replacements(replacement: str, sentence: str) -> None:
    assert sentence in str(refused(EXAMPLE, replacement))


def test_an_archive_is_no_scenario(tmp_path: Path) -> None:
    path = tmp_path / "robot.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", "<model/>")
    for read in (read_document, read_binding_document):
        with pytest.raises(InputError, match=r"is an archive \(zip\), perhaps an FMU; expected XML"):
            read(path)


@pytest.mark.parametrize(
    ("old", "new", "line", "sentence"),
    [
        ('x="1 mm"', 'xx="1 mm"', 36, "<noise> has no attribute 'xx': did you mean 'x'? Known: from, gamma"),
        ('psi="0 deg"', 'pis="0 deg"', 43, "<pose> has no attribute 'pis': did you mean 'psi'? Known: gamma, psi"),
        ("tau_drive=", "tau_dirve=", 44, "<torque> has no attribute 'tau_dirve': did you mean 'tau_drive'?"),
        ('<saturation limit="200 N.m"/>', '<rate limit="9 N.m"/>', 39, "expected a quantity such as '9 N.m/s'"),
        ('limit="200 N.m"', 'limit="200 Nm"', 39, "'200 Nm' is not a number with a unit: write '200 N.m'"),
    ],
)  # fmt: skip
def test_what_breaks_the_words_of_the_kinds_of_vehicle(
    tmp_path: Path, old: str, new: str, line: int, sentence: str
) -> None:
    with pytest.raises(InputError) as caught, ExitStack() as cleanup:
        set_up(read_scenario(variant(tmp_path, old, new)), cleanup, {})
    assert sentence in str(caught.value)
    assert caught.value.where is not None
    assert caught.value.where.line == line
