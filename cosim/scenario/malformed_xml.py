"""Why a text is not well-formed XML, in words that help to mend it."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from xml.parsers import expat
from xml.parsers.expat import errors

_CODE = errors.codes
_ATTRIBUTE_BEFORE = re.compile(r"([\w:.-]+)\s*=\s*([\"'])[^\"']*=\s*\2$")
_NEAR = 1000
"""How many characters before the error are searched for its reason: of a long word, a search takes the square."""
_C1 = re.compile(rb"[\x80-\x9f]")


def reason(data: bytes, index: int, code: int, opened: Sequence[tuple[str, int]]) -> str:
    """Return the fault and its remedy, as the second half of a sentence.

    Parameters
    ----------
    data
        The file.
    index, code
        Expat's position of the fault in bytes, and its error code.
    opened
        The elements that are open there, each with its line; the innermost is the last.
    """
    before, after = (part.decode("utf-8", "replace") for part in (data[: max(index, 0)], data[max(index, 0) :]))
    name = match[0] if (match := re.match(r"[\w:.-]+", after.lstrip("&"))) else ""
    last, line = opened[-1] if opened else ("", 0)
    if code == _CODE[errors.XML_ERROR_INVALID_TOKEN]:
        return _undecodable(data, index) or _unexpected(before, after)
    if code == _CODE[errors.XML_ERROR_NO_ELEMENTS]:
        return f"it ends, but <{last}> of line {line} is not closed: </{last}> is missing" if opened else "it is empty"
    if code == _CODE[errors.XML_ERROR_TAG_MISMATCH]:
        if name in (tag for tag, _ in opened):
            return f"</{last}> is missing before </{name}>: <{last}> of line {line} is not closed"
        return f"</{name}> closes nothing; expected </{last}>, for <{last}> of line {line}"
    if code == _CODE[errors.XML_ERROR_UNCLOSED_TOKEN]:
        missing = (
            "the --> of this comment" if after.startswith("<!--") else "the > of this tag, or a closing quote in it,"
        )
        return f"{missing} is missing"
    if code == _CODE[errors.XML_ERROR_UNDEFINED_ENTITY]:
        return f"&{name}; is not known: XML has only &amp; &lt; &gt; &quot; and &apos;, so write the character itself"
    if code == _CODE[errors.XML_ERROR_DUPLICATE_ATTRIBUTE]:
        return f"the attribute {name!r} is given twice"
    if code == _CODE[errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT]:
        return "nothing may follow the end of the root element"
    if code == _CODE[errors.XML_ERROR_MISPLACED_XML_PI]:
        return "<?xml ...?> must be the very beginning of the file: remove what is before it"
    if code == _CODE[errors.XML_ERROR_XML_DECL]:
        return 'the first line is not as expected; write <?xml version="1.0" encoding="UTF-8"?>'
    if code == _CODE[errors.XML_ERROR_INCORRECT_ENCODING]:
        return "the file is not in the encoding that it declares: save it in UTF-8 and declare that"
    if code == _CODE[errors.XML_ERROR_SYNTAX]:
        return "a tag such as <scenario> is expected"
    return expat.ErrorString(code) or "it cannot be read"


def _undecodable(data: bytes, index: int) -> str:
    """Name the likely encoding of the file, if the byte of an index is no part of a character in UTF-8."""
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start != index:
            return ""
    else:
        return ""
    name = "Windows-1252" if _C1.search(data) else "ISO-8859-1"
    seen = data[index : index + 1].decode(name, "replace")
    if not unicodedata.category(seen).startswith(("L", "N", "P", "S")) or seen == "\N{REPLACEMENT CHARACTER}":
        return f"the byte 0x{data[index]:02X} is no text in UTF-8: save the file in that encoding"
    shown = {"ISO-8859-1": "Latin-1"}.get(name, name)
    return (
        f"the byte 0x{data[index]:02X} is no text in UTF-8; the file seems to be in {shown}, where it is {seen!r}: "
        f'save it in UTF-8, or declare it in the first line, as in <?xml version="1.0" encoding="{name}"?>'
    )


def _unexpected(before: str, after: str) -> str:
    """Return why a character is not expected at its place."""
    character = after[:1]
    if re.search(r"&[^\s;<>\"']*$", before[-_NEAR:]):
        return "an & stands for the beginning of an entity: write &amp; for the character itself"
    if character and unicodedata.category(character) == "Cc" and character not in "\t\n\r":
        return f"the control character 0x{ord(character):02X} cannot be in an XML file: remove it"
    if before.rfind("<!--") > before.rfind("-->"):
        return "a comment cannot have -- in it: only its end is -->"
    begin = before.rfind("<")
    tag, line = before[max(begin, len(before) - _NEAR) :], before.count("\n", 0, begin) + 1
    if character == "<":
        return f"a closing quote is missing in the tag that begins in line {line}; or write &lt; for a < in a value"
    if begin <= before.rfind(">"):
        return f"{character!r} is not expected here"
    if tag == "<":
        return "a < stands for the beginning of a tag: write &lt; for the character itself"
    if match := _ATTRIBUTE_BEFORE.search(tag):
        return f"the value of {match[1]!r} lacks its closing quote"
    if tag.rstrip().endswith("="):
        return 'a value stands in straight quotes, as in x="1 m"'
    if tag.endswith(("'", '"')):
        return "a space is missing between two attributes, or a quote is one too many"
    if match := re.search(r"\s([\w:.-]+)\s*$", tag):
        return f'the attribute {match[1]!r} has no value; expected {match[1]}="..."'
    return f"{character!r} is not expected in a tag"
