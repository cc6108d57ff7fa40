"""FMU files that are broken, or bad on purpose, each in one way."""

import re
import zipfile
from pathlib import Path

from plants.factory.platforms import PLATFORMS, host

from .stub import Options, binary, binary_path, description, folder, write

BROKEN = {
    "empty_file": "has no bytes",
    "no_zip": "is a text",
    "empty_zip": "has no entries",
    "truncated": "ends in the middle",
    "crc": "has a byte of the binary flipped",
    "description_crc": "has a byte of the model description flipped",
    "encrypted": "says that its entries are encrypted",
    "no_description": "has no modelDescription.xml",
    "two_descriptions": "has two entries modelDescription.xml, of other models",
    "no_xml": "has a model description that is not XML",
    "no_utf8": "has a model description that is not in its encoding",
    "fmi_4": "is FMI 4.0",
    "entity_bomb": "has entities that would grow to gigabytes",
    "external_entity": "has an entity that is a file of this machine",
    "parent_entry": "has the entry ../formation-stub-evil",
    "backslash_entry": "has the entry ..\\formation-stub-evil",
    "absolute_entry": "has the entry /tmp/formation-stub-evil",
    "link_entry": "has a symbolic link out of itself, and an entry below that",
    "identifier_outside": "has the model identifier ../../formation-stub-evil",
    "no_identifier": "has an empty model identifier",
    "duplicate_names": "has two variables named x",
    "duplicate_references": "has two variables of one value reference, which only FMI 3 forbids",
    "undefined_unit": "has units that it does not define",
    "no_start": "has an input without a start value",
    "wrong_token": "has a token other than its binary's",
    "no_binaries": "has no folder of binaries",
    "other_platforms": "has binaries only for other platforms",
    "other_machine": "has, for this platform, a binary for another processor",
    "text_binary": "has a text as binary",
    "empty_binary": "has a binary of no bytes",
    "misnamed_binary": "has a binary of another name than the model identifier",
    "no_do_step": "has a binary that lacks the function that takes a step",
}
"""What is wrong with a file that `make_broken` writes."""

DESCRIPTION = "modelDescription.xml"

EVIL = "formation-stub-evil"
"""Name of the files that should never come into being."""


def make_broken(where: Path, kind: str, **options: object) -> Path:
    """Write a broken FMU, `where`/`kind`.fmu, and return its path.

    Parameters
    ----------
    kind
        One of BROKEN.
    options
        Of `make_fmu`, for what is not broken.
    """
    if kind not in BROKEN:
        raise ValueError(f"there is no kind {kind!r}: {', '.join(BROKEN)}")
    chosen = Options(**options)  # type: ignore[arg-type]
    path = where / f"{kind}.fmu"
    content = _content(kind, chosen)
    write(path, content)
    if kind == "empty_file":
        path.write_bytes(b"")
    elif kind == "no_zip":
        path.write_bytes(b"This is no zip archive.\n")
    elif kind == "truncated":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    elif kind == "encrypted":
        _set_flag(path, 1)
    elif kind in ("crc", "description_crc"):
        _flip(path, content, DESCRIPTION if kind == "description_crc" else binary_path(chosen))
    elif kind == "two_descriptions":
        another = description(chosen).replace(f'modelName="{chosen.name}"', 'modelName="another"')
        write(path, {"another_description_": another.encode(), **content})  # a name of the same length
        path.write_bytes(path.read_bytes().replace(b"another_description_", DESCRIPTION.encode()))
    elif kind == "link_entry":
        with zipfile.ZipFile(path, "a") as archive:
            link = zipfile.ZipInfo("resources/link")
            link.external_attr = 0o120777 << 16
            archive.writestr(link, "/tmp")
            archive.writestr(f"resources/link/{EVIL}", b"evil")
    return path


def _content(kind: str, options: Options) -> dict[str, bytes]:
    """Return the entries, with their faults."""
    place = binary_path(options)
    library = binary(options.fmi, options.name, ("WITHOUT_DO_STEP",) if kind == "no_do_step" else ())
    encoding = "latin-1" if kind == "no_utf8" else "utf-8"
    content = {DESCRIPTION: _description(kind, options).encode(encoding), place: library}
    if kind == "empty_zip":
        return {}
    if kind == "no_description":
        del content[DESCRIPTION]
    elif kind in ("no_binaries", "other_platforms", "misnamed_binary"):
        del content[place]
    entries = {
        "misnamed_binary": {place.replace(f"/{options.name}.", "/another."): library},
        # The processor in the header of ELF, or something near the beginning of other formats.
        "other_machine": {place: library[:18] + bytes([library[18] ^ 0xFF]) + library[19:]},
        "text_binary": {place: b"This is no shared library.\n"},
        "empty_binary": {place: b""},
        "parent_entry": {f"../{EVIL}": b"evil"},
        "backslash_entry": {f"..\\{EVIL}": b"evil"},
        "absolute_entry": {f"/tmp/{EVIL}": b"evil"},
        "other_platforms": {
            f"binaries/{folder(platform, options.fmi)}/{options.name}{platform.suffix}": b"for another platform"
            for platform in PLATFORMS.values()
            if folder(platform, options.fmi) != folder(host(), options.fmi)
        },
    }
    return content | entries.get(kind, {})


def _description(kind: str, options: Options) -> str:
    """Return the model description, with its faults."""
    root, identifier = "<fmiModelDescription ", f'modelIdentifier="{options.name}"'
    bomb = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    external = f'<!DOCTYPE d [<!ENTITY e SYSTEM "{Path(__file__).as_uri()}">]>'
    replaced = {
        "no_utf8": [('generationTool="', 'generationTool="Z\N{LATIN SMALL LETTER U WITH DIAERESIS}rich ')],
        "fmi_4": [(f'fmiVersion="{options.fmi}"', 'fmiVersion="4.0"')],
        "entity_bomb": [(root, f'<!DOCTYPE d [<!ENTITY e0 "ha">{bomb}]>{root}author="&e11;" ')],
        "external_entity": [(root, external + root), ("</ModelVariables>", "&e;</ModelVariables>")],
        "identifier_outside": [(identifier, f'modelIdentifier="../../{EVIL}"')],
        "no_identifier": [(identifier, 'modelIdentifier=""')],
        "duplicate_names": [(' name="y"', ' name="x"')],
        "duplicate_references": [('valueReference="1"', 'valueReference="0"')],
        "wrong_token": [(options.token, "{00000000-0000-0000-0000-000000000000}")],
    }
    if kind == "no_xml":
        return "This is no XML.\n"
    xml = description(options)
    for old, new in replaced.get(kind, []):
        assert old in xml
        xml = xml.replace(old, new)
    if kind == "no_start":
        xml = re.sub(r'(name="tau_drive"[^\n]*?) start="0"', r"\1", xml)
    elif kind == "undefined_unit":
        xml = re.sub(r" *<UnitDefinitions>.*</UnitDefinitions>\n", "", xml, flags=re.DOTALL)
    return xml


def _flip(path: Path, content: dict[str, bytes], entry: str) -> None:
    """Write an archive in which one bit of an entry is another than its checksum was computed of."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    whole = bytearray(path.read_bytes())
    whole[whole.index(content[entry]) + len(content[entry]) // 2] ^= 1
    path.write_bytes(whole)


def _set_flag(path: Path, flag: int) -> None:
    """Set a flag of all entries, in both of their headers."""
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        at = data.find(signature)
        while at >= 0:
            data[at + offset] |= flag
            at = data.find(signature, at + 4)
    path.write_bytes(data)
