"""From the text of a scenario file to a checked XML tree in which every element knows its place.

Nothing outside the file is read except the bases of a variant. The tree is lxml's, which checks it against the schema
and answers XPath.
"""

from __future__ import annotations

import copy
import os
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from lxml import etree

from cosim.errors import InputError, Location, listed
from cosim.missing_file import absent
from cosim.scenario.edits import Change, Edit, in_words
from cosim.scenario.grammar import NAMESPACE, local_name, paths_in, violation
from cosim.scenario.root_element import MAX_BYTES as MAX_BYTES
from cosim.scenario.tree_edits import add_namespace, serialised, strip_namespace
from cosim.scenario.variant import vary
from cosim.scenario.white_space import collapse
from cosim.scenario.xml_tree import parsed

MAX_VARIANTS = 20
_PREFIX = f"{{{NAMESPACE}}}"
_ARCHIVE = b"PK\x03\x04"
"""How a zip archive begins."""


@dataclass(frozen=True)
class Document:
    """A scenario document that satisfies the schema.

    Attributes
    ----------
    path : Path
        The file that it was read from; paths in the document are relative to its folder.
    text : str
        The resolved text: the scenario with its variants and every change.
    root : lxml.etree._Element
        The tree; tags carry the namespace.
    """

    path: Path
    text: str
    root: etree._Element
    _places: dict[etree._Element, Location]

    def where(self, element: etree._Element) -> Location:
        """Return the place of an element in the file where it was written, or of the rule that changed it."""
        return self._places[element]

    @property
    def places(self) -> tuple[Location, ...]:
        """The places of all elements, in the order of the text."""
        return tuple(self._places[element] for element in self.root.iter("*"))

    def changed(self, changes: Sequence[Change]) -> Document:
        """Return the document with changes; this one stays as it is.

        Raises
        ------
        InputError
            A change does not apply, or breaks the schema.
        """
        root = copy.deepcopy(self.root)
        return _changed(
            Document(self.path, self.text, root, dict(zip(root.iter("*"), self.places, strict=True))), changes
        )


def read_document(path: Path, changes: Sequence[Change] = ()) -> Document:
    """Read a scenario file, or a variant of one, change it as asked, and check it against the schema.

    White space around the values of attributes is removed. Within them it is collapsed, as the schema reads it, but in
    paths and in names of variables it is kept. The paths in a document are relative to the folder of the file that is
    read: the paths of a base in another folder are rewritten.

    Raises
    ------
    InputError
        The file cannot be read, is not XML, declares a document type, breaks the schema, or a change does not apply;
        with file, line and column.
    """
    return _changed(_resolve(path, ()), changes)


def parse_document(text: str, path: Path, places: Sequence[Location] = (), changes: Sequence[Change] = ()) -> Document:
    """Return the document of a scenario's resolved text, changed as asked and checked against the schema.

    Parameters
    ----------
    text, path
        As of `Document`.
    places
        Its `places`, where they are known; otherwise an element is where it stands in the text.
    changes
        As of `read_document`.

    Raises
    ------
    InputError
        As of `read_document`.
    """
    root, found = parsed(text.encode(), path)
    _check_names(root, found, "scenario")
    known = dict(zip(root.iter("*"), places, strict=True)) if places else found
    return _changed(Document(path, text, root, known), changes)


def read_binding_document(path: Path) -> Document:
    """Read a file whose root element is a binding, and check it against the schema.

    Raises
    ------
    InputError
        As of `read_document`.
    """
    return _read(path, "binding")


def read_mapping_document(path: Path) -> Document:
    """Read a file whose root element is a mapping, and check it against the schema.

    Raises
    ------
    InputError
        As of `read_document`.
    """
    return _read(path, "mapping")


def read_study_document(path: Path) -> Document:
    """Read a file whose root element is a study, and check it against the schema.

    Raises
    ------
    InputError
        As of `read_document`.
    """
    return _read(path, "study")


def read_variant_of(
    of: str,
    document: Document,
    rules: Sequence[etree._Element],
    changes: Sequence[Change] = (),
    places: Mapping[etree._Element, Location] | None = None,
) -> Document:
    """Return a scenario to which rules are applied that stand in a document of another kind, as in a variant.

    Parameters
    ----------
    of
        The scenario's file, relative to the document's folder, as all paths in the result.
    document
        The document that holds the rules; the scenario gets its name.
    rules
        Children that a variant has, in it.
    changes
        Made after these.
    places
        The places of elements that the changes bring.

    Raises
    ------
    InputError
        The scenario is not valid, or a rule cannot be applied; with its place.
    """
    name = document.root.get("name", "")
    variant = etree.Element(f"{{{NAMESPACE}}}variant", {"name": name, "of": of}, {None: NAMESPACE})
    known = {variant: document.where(document.root)}
    for rule in rules:
        variant.append(copied := copy.deepcopy(rule))
        copied.tail = None
        known |= zip(copied.iter("*"), map(document.where, rule.iter("*")), strict=True)
    varied = _varied(document.path, variant, known, ())
    varied._places.update(places or {})
    return _changed(varied, changes)


def _read(path: Path, kind: str) -> Document:
    """Read a file with a root element of a kind, which stands for itself."""
    data = _read_bytes(path)
    root, places = parsed(data, path)
    _check_names(root, places, kind)
    _validate(root, places)
    return Document(path, _decode(data, root), root, places)


def _changed(document: Document, changes: Sequence[Change]) -> Document:
    """Make changes in a document, and check it against the schema."""
    root, places = document.root, document._places
    if not changes:
        _validate(root, places)
        return document
    strip_namespace(root)
    try:
        for change in changes:
            change(root)
            for element in root.iter("*"):
                if element not in places:
                    places[element] = Location(in_words(change))
    finally:
        add_namespace(root)
    collapse(root.iter("*"))
    _validate(root, places, changed_by=listed([change.words for change in changes if isinstance(change, Edit)]))
    return Document(document.path, serialised(root), root, places)


_USES = {
    "scenario": '"formation run" runs it',
    "variant": '"formation run" runs it',
    "study": '"formation study" makes its runs',
    "binding": "the attribute binding of a plant, or --binding, names it",
    "mapping": 'the option --map of "formation judge" names it',
}
"""What a file is for, by its root element."""


def _check_names(root: etree._Element, places: Mapping[etree._Element, Location], *roots: str) -> None:
    """Refuse a tree with another root element, or with elements of another namespace."""
    if root.tag not in [f"{_PREFIX}{expected}" for expected in roots]:
        expected = f"expected <{roots[0]} xmlns={NAMESPACE!r}>"
        if (use := _USES.get(str(root.tag).removeprefix(_PREFIX))) is not None and root.tag.startswith(_PREFIX):
            raise InputError(f"this is a {local_name(root)}: {use}; {expected}", places[root])
        raise InputError(f"the root element is {root.tag}; {expected}", places[root])
    for element, place in places.items():
        if not element.tag.startswith(_PREFIX):
            raise InputError(f"the element {element.tag} is not part of the scenario language", place)


def _resolve(path: Path, chain: tuple[Path, ...]) -> Document:
    """Read a file; a variant is applied to its base. A variant is checked against the schema, a scenario not yet.

    Parameters
    ----------
    path
        The file.
    chain
        The variants that have led here.
    """
    data = _read_bytes(path)
    root, places = parsed(data, path)
    _check_names(root, places, "scenario", "variant")
    if local_name(root) == "scenario":
        return Document(path, _decode(data, root), root, places)

    _validate(root, places)
    return _varied(path, root, places, chain)


def _varied(
    path: Path, root: etree._Element, places: dict[etree._Element, Location], chain: tuple[Path, ...]
) -> Document:
    """Apply a variant to its base."""
    base = _base(path, root, places[root], chain)
    strip_namespace(root)
    strip_namespace(base.root)
    _relocate(base.root, PurePath(root.get("of", "")).parent)
    places |= base._places
    vary(base.root, root, places)
    add_namespace(base.root)
    _validate(base.root, places, changed_by=str(path))
    return Document(path, serialised(base.root), base.root, places)


def _base(path: Path, variant: etree._Element, place: Location, chain: tuple[Path, ...]) -> Document:
    """Return the valid scenario that a variant is of."""
    of = variant.get("of", "")
    base, chain = _without_detours(path.parent / of), (*chain, path)
    shown = " -> ".join(str(file) for file in (*chain, base))
    if os.path.realpath(base) in map(os.path.realpath, chain):
        raise InputError(f"the variant refers back to itself: {shown}", place)
    if len(chain) > MAX_VARIANTS:
        raise InputError(f"a chain has at most {MAX_VARIANTS} variants, this one has more: {shown}", place)
    try:
        document = _resolve(base, chain)
    except InputError as error:
        if error.where == Location(str(base)):  # it cannot even be read
            raise InputError(f'of="{of}" of <variant>: {error.message}', place) from None
        raise
    _validate(document.root, document._places)
    return document


def _without_detours(path: Path) -> Path:
    """Return a path without ``..`` where it leads to the same file, so that messages are short."""
    shorter = Path(os.path.normpath(path))
    return shorter if os.path.realpath(shorter) == os.path.realpath(path) else path


def _relocate(root: etree._Element, folder: PurePath) -> None:
    """Prefix the relative paths in a tree without namespace."""
    if folder == PurePath():
        return
    for element, name in paths_in(root):
        element.set(name, (folder / element.get(name, "")).as_posix())


def _validate(root: etree._Element, places: Mapping[etree._Element, Location], changed_by: str = "") -> None:
    found = violation(root)
    if found is not None:
        element, sentence = found
        place = places[element]
        suffix = f" (as changed by {changed_by})" if changed_by not in ("", place.file) else ""
        raise InputError(sentence + suffix, place)


# Files ------------------------------------------------------------------------------------------------------


def _read_bytes(path: Path) -> bytes:
    place = Location(str(path))
    too_large = InputError(f"is larger than {MAX_BYTES // 1024**2} MiB, so it is no scenario file", place)
    archive = InputError(
        'is an archive (zip), perhaps an FMU; expected XML. "formation inspect" shows an FMU, which a <plant> '
        "or --plant names",
        place,
    )
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):  # a pipe or a device may never end
            raise InputError("is not a regular file", place)
        with path.open("rb") as file:
            data = file.read(len(_ARCHIVE))
            if data == _ARCHIVE:
                raise archive
            if stat.S_ISREG(status.st_mode) and status.st_size > MAX_BYTES:
                raise too_large
            data += file.read(MAX_BYTES + 1 - len(data))
    except FileNotFoundError:
        raise InputError(absent(path), place) from None
    except OSError as error:
        every = f": name the files in it, as in {path / '*.xml'}" if isinstance(error, IsADirectoryError) else ""
        raise InputError(f"cannot be read: {error.strerror}{every}", place) from None
    if len(data) > MAX_BYTES:  # it has grown
        raise too_large
    return data


def _decode(data: bytes, root: etree._Element) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # a declared encoding other than UTF-8, which expat has understood
        return serialised(root)
