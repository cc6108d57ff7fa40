"""FMUs as tools and people leave them on the disk: archives with backslashes and folders, and unpacked ones."""

import os
import re
import zipfile
from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.fmu.archive import has_document_type, size
from cosim.fmu.package import open_package
from cosim.fmu.vehicle import open_fmu
from tests.stub.stub import make_fmu


@pytest.fixture(scope="module")
def stub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_fmu(tmp_path_factory.mktemp("stub"))


def entries(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(path: Path, content: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return path


def unpacked(path: Path, folder: Path) -> Path:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


def usable(path: Path) -> str:
    """Open an FMU as a vehicle; return its checksum."""
    fmu = open_fmu(path)
    fmu.close()
    assert not fmu.directory.exists()
    return fmu.sha256


def refused(path: Path) -> str:
    with pytest.raises(InputError) as raised:
        open_package(path)
    return str(raised.value)


def test_backslashes_and_folders(stub: Path, tmp_path: Path) -> None:
    content = {name.replace("/", "\\"): data for name, data in entries(stub).items()}
    usable(zipped(tmp_path / "a.fmu", {"binaries\\": b"", "resources\\": b"", "empty/": b"", **content}))


@pytest.mark.parametrize("name", ["..\\out", "a\\..\\..\\out", "\\out", "C:\\out", "C:out"])
def test_backslashes_do_not_lead_outside(stub: Path, tmp_path: Path, name: str) -> None:
    path = zipped(tmp_path / "a.fmu", entries(stub) | {name: b""})
    assert f"has the entry {name!r}, which leads outside of the FMU" in refused(path)


def test_one_file_under_two_names(stub: Path, tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.fmu", entries(stub) | {"a/b": b"1", "a\\b": b"2"})
    assert "has the entry 'a/b' twice, with different content" in refused(path)


def test_one_file_that_was_added_twice(stub: Path, tmp_path: Path) -> None:
    usable(zipped(tmp_path / "a.fmu", entries(stub) | {"extra/a.xml": b"1", "extra\\a.xml": b"1"}))


def test_a_file_where_a_folder_is(stub: Path, tmp_path: Path) -> None:
    said = refused(zipped(tmp_path / "a.fmu", entries(stub) | {"a": b"", "a/b": b""}))
    assert "has the entry 'a/b', which cannot be unpacked: " in said


@pytest.mark.parametrize("name", ["a" * 300, "a/" * 3000 + "b", "é" * 200])
def test_names_that_no_file_can_have(stub: Path, tmp_path: Path, name: str) -> None:
    said = refused(zipped(tmp_path / "a.fmu", entries(stub) | {name: b""}))
    assert re.search(r"a\.fmu has the entry '\S+', which cannot be unpacked: File name too long$", said)


def test_a_folder_that_was_zipped_as_a_whole(stub: Path, tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.fmu", {f"my fmu/{name}": data for name, data in entries(stub).items()})
    assert refused(path).endswith(
        "but my fmu/modelDescription.xml: an FMU has it at the top, so zip what is in my fmu/"
    )


def test_an_unpacked_fmu(stub: Path, tmp_path: Path) -> None:
    folder = unpacked(stub, tmp_path / "my stub")
    before = sorted(folder.rglob("*"))
    first = usable(folder)
    assert sorted(folder.rglob("*")) == before
    assert usable(unpacked(stub, tmp_path / "copy")) == first
    assert size(folder) == sum(file.stat().st_size for file in before if file.is_file())
    (folder / "resources").mkdir()
    (folder / "resources" / "map.csv").write_text("1")
    assert usable(folder) != first


@pytest.mark.parametrize("linked", ["resources", "resources.txt"])
def test_links_in_an_unpacked_fmu_are_not_followed(stub: Path, tmp_path: Path, linked: str) -> None:
    folder = unpacked(stub, tmp_path / "stub")
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret.txt").write_text("secret")
    (folder / linked).symlink_to(tmp_path / linked.replace("resources", "secret"))
    assert f"has {linked!r}, which is no regular file" in refused(folder)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_in_an_unpacked_fmu(stub: Path, tmp_path: Path) -> None:
    folder = unpacked(stub, tmp_path / "stub")
    os.mkfifo(folder / "pipe")
    assert "has 'pipe', which is no regular file" in refused(folder)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("name", ["water-tank", "reversed.fmu", "1st", "größe"])
def test_model_identifiers_are_names_of_files(tmp_path: Path, fmi: str, name: str) -> None:
    usable(make_fmu(tmp_path, fmi=fmi, name=name))


@pytest.mark.parametrize("identifier", ["", ".", "..", "../stub", "a\\b", "C:stub"])
def test_model_identifiers_that_lead_elsewhere(stub: Path, tmp_path: Path, identifier: str) -> None:
    content = entries(stub)
    old, new = (f'modelIdentifier="{text}"'.encode() for text in ("stub", identifier))
    content["modelDescription.xml"] = content["modelDescription.xml"].replace(old, new)
    with pytest.raises(InputError, match="which is no name of a file") as raised:
        open_fmu(zipped(tmp_path / "a.fmu", content))
    assert f"has the model identifier {identifier!r}" in raised.value.message


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
@pytest.mark.parametrize("name", ["a" * 251, "é" * 126])
def test_model_identifiers_that_are_too_long_for_a_file(tmp_path: Path, fmi: str, name: str) -> None:
    content = entries(make_fmu(tmp_path, fmi=fmi, interface="co_simulation"))
    old, new = (f'modelIdentifier="{text}"'.encode() for text in ("stub", name))
    content["modelDescription.xml"] = content["modelDescription.xml"].replace(old, new)
    with pytest.raises(InputError, match="which is too long for the name of a file: at most 250 bytes"):
        open_fmu(zipped(tmp_path / "a.fmu", content))


def test_another_interface_s_model_identifier_is_too_long(tmp_path: Path) -> None:
    content = entries(make_fmu(tmp_path, interface="both"))
    before, found, after = content["modelDescription.xml"].partition(b'<ModelExchange modelIdentifier="')
    assert found
    content["modelDescription.xml"] = before + found + b"a" * 300 + after
    usable(zipped(tmp_path / "a.fmu", content))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "windows-1252", "gbk", "shift_jis", "utf-7"])
@pytest.mark.parametrize(
    "declared", ["", "<!DOCTYPE a>", '<!DOCTYPE a [<!ENTITY b "c">]>', '<!DOCTYPE a SYSTEM "b.dtd">']
)
def test_document_types_in_any_encoding(encoding: str, declared: str) -> None:
    xml = f'<?xml version="1.0" encoding="{encoding}"?><!-- first -->{declared}<a b="c"/>'
    assert has_document_type(xml.encode(encoding)) == bool(declared)


@pytest.mark.parametrize(
    "xml", [b"", b"no XML", b"<a>", b"<a/><!DOCTYPE a>", b'<?xml version="1.0" encoding="x"?><a/>']
)
def test_what_is_not_xml_declares_no_document_type(xml: bytes) -> None:
    assert not has_document_type(xml)


def test_a_document_type_behind_a_long_comment() -> None:
    assert has_document_type(b"<!--" + b"x" * 11_000_000 + b"--><!DOCTYPE a><a/>")


def test_entities_are_not_expanded_in_an_encoding_that_few_parsers_know(stub: Path, tmp_path: Path) -> None:
    content = entries(stub)
    xml = content["modelDescription.xml"].decode()
    begin = xml.index("<fmiModelDescription")
    content["modelDescription.xml"] = (
        f'<?xml version="1.0" encoding="gbk"?><!DOCTYPE fmiModelDescription [<!ENTITY e "x">]>{xml[begin:]}'.encode(
            "gbk"
        )
    )
    assert "declares a document type in its modelDescription.xml" in refused(zipped(tmp_path / "a.fmu", content))
    build = b'<!DOCTYPE fmiBuildDescription><fmiBuildDescription fmiVersion="3.0"/>'
    path = zipped(tmp_path / "b.fmu", entries(stub) | {"sources/buildDescription.xml": build})
    assert "declares a document type in its sources/buildDescription.xml" in refused(path)


def test_more_files_than_any_fmu_has(stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is refused before anything is known about the files, whatever the archive says of their number."""
    path = zipped(tmp_path / "a.fmu", entries(stub) | {f"resources/{i}": b"" for i in range(1000)})
    usable(path)
    monkeypatch.setattr("cosim.fmu.archive.MAX_FILES", 300)
    monkeypatch.setattr("cosim.fmu.archive.zipfile.ZipInfo", None)
    assert refused(path) == f"{path} is not an FMU: it has more than 300 files"


def test_a_folder_with_more_files_than_any_fmu_has(stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = unpacked(stub, tmp_path / "a")
    monkeypatch.setattr("cosim.fmu.archive.MAX_FILES", 1)
    assert "files; at most 1 are unpacked" in refused(folder)


def test_a_table_of_contents_that_is_too_long(stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = zipped(tmp_path / "a.fmu", entries(stub) | {f"resources/{'x' * 2000}/{i}": b"" for i in range(20)})
    monkeypatch.setattr("cosim.fmu.archive.MAX_FILES", 25)
    assert refused(path) == f"{path} is not an FMU: it has more than 25 files"


HEAD = (
    '<fmiModelDescription fmiVersion="2.0" modelName="a" guid="b"><CoSimulation modelIdentifier="a"/><ModelVariables>'
)


def test_a_description_of_more_elements_than_any_fmu_has(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.fmu", {"modelDescription.xml": HEAD.encode() + b"<a/>" * 2_100_000})
    assert "beginnings and ends of elements; at most 2000000 are read" in refused(path)


def test_of_many_breaches_the_first_are_reported(tmp_path: Path) -> None:
    bad = '<ScalarVariable name="v" valueReference="1"/>\n' * 30_000
    text = f"{HEAD}\n\n{bad}</ModelVariables></fmiModelDescription>"
    path = zipped(tmp_path / "a.fmu", {"modelDescription.xml": text.encode()})
    assert "line 3: Element 'ScalarVariable': Missing child element(s)." in refused(path)
    mark = {7: ' q="1"', 9_000: ' q="1"'}
    good = "".join(
        f'<ScalarVariable name="v{i}" valueReference="{i}"><Real{mark.get(i, "")}/></ScalarVariable>\n'
        for i in range(10_000)
    )
    text = f"{HEAD}\n\n{good}</ModelVariables><ModelStructure/></fmiModelDescription>"
    package = open_package(zipped(tmp_path / "b.fmu", {"modelDescription.xml": text.encode()}))
    package.close()
    assert [problem.partition(":")[0] for problem in package.problems] == ["line 10", "line 9003"]
