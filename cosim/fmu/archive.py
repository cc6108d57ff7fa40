"""An FMU or an SSP as it lies on the disk, an archive or the folder of an unpacked one: checked, and unpacked.

Nothing gets out of that folder, and nothing gets in from elsewhere: entries that point outside and links are refused.
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
import shutil
import stat
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from lxml import etree

from cosim.errors import InputError, Location
from cosim.missing_file import absent
from cosim.unforeseen import lack_of

DESCRIPTION = "modelDescription.xml"
READ = (DESCRIPTION, "sources/buildDescription.xml")
"""The files of an FMU that FMPy reads as XML."""
_BLOCK = 2**16
MAX_UNPACKED_BYTES = 2 * 1024**3
MAX_DESCRIPTION_BYTES = 64 * 1024**2
MAX_FILES = 50_000
MAX_TAGS = 2_000_000
"""Beginnings and ends of elements in a model description."""


@dataclass(frozen=True)
class Sort:
    """A sort of archive.

    Attributes
    ----------
    name : str
        Its name in messages.
    main : str
        The file at its top that describes it.
    about : str
        The name of that file in messages.
    xml : tuple of str
        Its files that are read as XML.
    """

    name: str
    main: str
    about: str
    xml: tuple[str, ...]


FMU = Sort("FMU", DESCRIPTION, "model description", READ)


def unpack(path: Path, directory: Path, where: Location | None = None, sort: Sort = FMU) -> str:
    """Unpack an FMU, or another sort of archive, into an empty folder and return its SHA-256.

    That of a folder is the one of its files' relative paths and checksums, in the order of the paths.

    Raises
    ------
    InputError
        It is no such archive, leads outside, has a file in two versions, or is larger than any; `where` asks for it.
    """
    try:
        if os.path.isdir(path):
            sha256 = _copy(path, directory, where, sort)
        elif os.path.exists(path) and not os.path.isfile(path):  # a pipe or a device may never end
            raise InputError(f"the {sort.name} {path} is not a regular file", where)
        else:
            with path.open("rb") as file:
                sha256 = hashlib.file_digest(file, "sha256").hexdigest()
            _extract(path, directory, where, sort)
    except FileNotFoundError:
        raise InputError(f"the {sort.name} {path} cannot be read: {absent(path)}", where) from None
    except OSError as error:
        what = f"unpacked into {directory.parent}" if lack_of(error) else "read"
        raise InputError(f"the {sort.name} {path} cannot be {what}: {error.strerror or error}", where) from None
    for name in sort.xml:
        if (part := directory / name).is_file() and has_document_type(part.read_bytes()):
            raise InputError(f"the {sort.name} {path} declares a document type in its {name}", where)
    return sha256


def size(path: Path) -> int:
    """Return how many bytes an FMU has on the disk."""
    return sum(file.stat().st_size for _, file in _files(path)) if path.is_dir() else path.stat().st_size


def has_document_type(xml: bytes) -> bool:
    """Return whether an XML document declares a document type; False for a text that is not XML.

    It is asked of the parser that reads the document later: another one may not know its encoding.
    """
    parser = etree.XMLParser(target=_Beginning(), resolve_entities=False, no_network=True, huge_tree=True)
    try:
        for begin in range(0, len(xml), _BLOCK):
            parser.feed(xml[begin : begin + _BLOCK])
    except _DocumentType:
        return True
    except (_RootElement, etree.XMLSyntaxError):
        return False
    return False


class _DocumentType(Exception):
    """A document declares its type."""


class _RootElement(Exception):
    """The root element begins: no document type can follow."""


class _Beginning:
    """Follows a document up to its root element."""

    def doctype(self, *_: object) -> None:
        raise _DocumentType

    def start(self, *_: object) -> None:
        raise _RootElement

    def close(self) -> None:
        """Nothing is built."""


# Archives ---------------------------------------------------------------------------------------------------


_ENCRYPTED = 1
_ENTRY = b"PK\1\2"
"""How an entry of a table of contents begins."""
_LONGEST_ENTRY = 1000
_DAMAGED = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, ValueError)


class _Archive(io.FileIO):
    """An archive of which the table of contents is read whole, as `zipfile` does, only if it is not too long."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return some bytes; refuse a table of contents with more than `MAX_FILES` entries before it is understood."""
        size = -1 if size is None else size
        most = MAX_FILES * _LONGEST_ENTRY
        data = super().read(size if 0 <= size <= most else most + 1) or b""
        if len(data) > most or (size > MAX_FILES and data.count(_ENTRY) > MAX_FILES):
            raise zipfile.BadZipFile(f"it has more than {MAX_FILES} files")
        return data


def _extract(path: Path, directory: Path, where: Location | None, sort: Sort) -> None:
    try:
        with _Archive(path, "rb") as file, zipfile.ZipFile(file) as archive:
            places = _places(path, archive, where, sort)
            _check_sizes(path, {place: entry.file_size for place, entry in places.items()}, where, sort)
            _write(archive, places.pop(PurePosixPath(sort.main)), directory / sort.main)
            try:
                for place, entry in places.items():
                    _write(archive, entry, directory.joinpath(*place.parts))
            except _DAMAGED as error:
                raise InputError(f"the {sort.name} {path} cannot be unpacked: {error}", where) from None
            except OSError as error:
                if error.errno == errno.EINVAL or lack_of(error):
                    raise
                why = f"has the entry {str(place)!r}, which cannot be unpacked: {error.strerror or error}"
                raise InputError(f"the {sort.name} {path} {why}", where) from None
    except _DAMAGED as error:
        raise InputError(f"{path} is not an {sort.name}: {error}", where) from None
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        why = "its table of contents points outside of the file: bytes are missing, or the table is wrong"
        raise InputError(f"{path} is not an {sort.name}: {why}", where) from None


def _write(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(entry) as source, target.open("xb") as file:
        shutil.copyfileobj(source, file)


def _places(
    path: Path, archive: zipfile.ZipFile, where: Location | None, sort: Sort
) -> dict[PurePosixPath, zipfile.ZipInfo]:
    """Return the files of an archive by where they belong."""
    places: dict[PurePosixPath, zipfile.ZipInfo] = {}
    for entry in archive.infolist():
        name = entry.filename.replace("\\", "/")  # as some tools write it on Windows
        place = PurePosixPath(name)
        if ".." in place.parts or place.is_absolute() or ":" in name:
            outside = f"has the entry {entry.filename!r}, which leads outside of the {sort.name}"
            raise InputError(f"the {sort.name} {path} {outside}", where)
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise InputError(f"the {sort.name} {path} has the symbolic link {entry.filename!r}, not a file", where)
        if entry.flag_bits & _ENCRYPTED:
            raise InputError(f"{path} is not an {sort.name}: its entry {entry.filename!r} is encrypted", where)
        if name.endswith("/"):  # a folder
            continue
        first = places.setdefault(place, entry)
        if (first.file_size, first.CRC) != (entry.file_size, entry.CRC):  # some tools add the same file again
            raise InputError(
                f"the {sort.name} {path} has the entry {str(place)!r} twice, with different content", where
            )
    return places


def _check_sizes(path: Path, sizes: dict[PurePosixPath, int], where: Location | None, sort: Sort) -> None:
    main = PurePosixPath(sort.main)
    if main not in sizes:
        deeper = next((place for place in sizes if place.name == sort.main), None)
        at_top = f"an {sort.name} has it at the top"
        hint = "" if deeper is None else f", but {deeper}: {at_top}, so zip what is in {deeper.parent}/"
        raise InputError(f"{path} is not an {sort.name}: it holds no {sort.main}{hint}", where)
    if (unpacked := sum(sizes.values())) > MAX_UNPACKED_BYTES:
        raise InputError(f"the {sort.name} {path} would unpack to {unpacked / 1024**3:.1f} GiB", where)
    if len(sizes) > MAX_FILES:
        raise InputError(f"the {sort.name} {path} has {len(sizes)} files; at most {MAX_FILES} are unpacked", where)
    if sizes[main] > MAX_DESCRIPTION_BYTES:
        raise InputError(f"the {sort.name} {path} has a {sort.about} of more than 64 MiB", where)


# Folders ----------------------------------------------------------------------------------------------------


def _copy(path: Path, directory: Path, where: Location | None, sort: Sort) -> str:
    """Copy an unpacked archive, so that later changes of its folder have no effect; return its checksum."""
    if not (path / sort.main).exists():
        raise InputError(f"the folder {path} is no unpacked {sort.name}: it holds no {sort.main}", where)
    files = dict(_files(path))
    for place, file in files.items():
        if not stat.S_ISREG(file.lstat().st_mode):
            raise InputError(f"the {sort.name} {path} has {str(place)!r}, which is no regular file", where)
    _check_sizes(path, {place: file.stat().st_size for place, file in files.items()}, where, sort)
    total = hashlib.sha256()
    for place, file in files.items():
        target = directory.joinpath(*place.parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        with file.open("rb") as source, target.open("xb") as copy:
            total.update(f"{place}\0{_copied(source, copy)}\n".encode("utf-8", "surrogateescape"))
    return total.hexdigest()


def _files(folder: Path) -> Iterator[tuple[PurePosixPath, Path]]:
    """Return all files of a folder by their relative paths, in the order of these; links are not followed."""
    found = []
    for root, folders, names in os.walk(folder):
        links = [name for name in folders if os.path.islink(os.path.join(root, name))]
        found += [Path(root, name) for name in (*names, *links)]
    yield from sorted((PurePosixPath(file.relative_to(folder).as_posix()), file) for file in found)


def _copied(source: BinaryIO, target: BinaryIO) -> str:
    digest = hashlib.sha256()
    while block := source.read(_BLOCK):
        digest.update(block)
        target.write(block)
    return digest.hexdigest()
