"""
Read and decode the text of a URDF, and parse it to plain elements.

Unsafe XML (document type and entity declarations) is rejected.
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import os
from pathlib import Path
import re
from xml.etree import ElementTree
from xml.parsers import expat

from kane_dynamics._util.file_kinds import kind_of_content
from kane_dynamics.errors import InputError, UrdfError
from kane_dynamics.urdf.xacro_file import expand_xacro, SUFFIX

DEPTH = 4  # robot / link / inertial / mass: dynamics needs no deeper elements
BOMS = ((codecs.BOM_UTF32_LE, 'utf-32'), (codecs.BOM_UTF32_BE, 'utf-32'),
        (codecs.BOM_UTF8, 'utf-8-sig'), (codecs.BOM_UTF16_LE, 'utf-16'),
        (codecs.BOM_UTF16_BE, 'utf-16'), (b'<\0\0\0', 'utf-32-le'),
        (b'\0\0\0<', 'utf-32-be'),
        (b'<\0', 'utf-16-le'), (b'\0<', 'utf-16-be'))
ENCODING = re.compile(rb'\s*<\?xml[^>]{0,200}?encoding\s*=\s*["\']([\w.-]{1,40})["\']')
ENCODINGS = re.compile(r'utf-?(8|16|32)|(us-)?ascii|iso-8859-\d{1,2}|(windows-|cp)125\d',
                       re.I)
# Other encodings than UTF-8 look like binary files.
MAY_BE_XML = ('a URDF', 'an MJCF file', 'an SDF file', 'XML', 'a binary file',
              'an empty file')
UNREAD = ('visual',
          'collision', 'material')  # appearance only; meshes and textures are not opened


@dataclass
class Element:
    """An XML element: tag, attributes, line in the text, children in order."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def find_all(self, tag: str) -> Iterator[Element]:
        """Yield the children with this tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """Return the first child with this tag, or None."""
        return next(self.find_all(tag), None)


def read_source(source: str | bytes | os.PathLike[str]) -> str:
    """
    Return the text of a URDF given as a path, text or bytes; a xacro file is expanded.

    Raises
    ------
    UrdfError
        If it cannot be read or expanded.

    """
    if isinstance(source, (bytes, bytearray)):
        return _decode(bytes(source))
    # Text begins with a tag; all other text is a path.
    if isinstance(source, str) and source.lstrip('\ufeff \t\r\n').startswith('<'):
        return source.lstrip('\ufeff')
    if not isinstance(source, (str, os.PathLike)):
        raise InputError(f'source: {type(source).__name__}; expected a path, or the XML '
                         'as str or bytes')
    if source == '':  # a path would be this directory
        raise UrdfError('source: an empty text; expected the path of a URDF file, or its '
                        'XML as str or bytes')
    if os.fspath(source).endswith(SUFFIX):
        return expand_xacro(source)
    try:
        path = f'source: {_short_path(os.fspath(source))}'
        data = Path(source).read_bytes()
        kind = kind_of_content(data)
        if kind not in MAY_BE_XML:
            raise UrdfError(f'{path}: seems to be {kind}; expected a URDF')
        text = _decode(data, path)
        if not text.strip():
            raise UrdfError(f'{path}: an empty file; expected a URDF')
        return text
    except (OSError, TypeError, ValueError) as error:
        if isinstance(error, UrdfError):
            raise
        if isinstance(error, FileNotFoundError):
            kind = 'an address' if '://' in os.fspath(source) else 'no such file'
            raise UrdfError(f'{kind}: {_short_path(os.fspath(source))}; expected '
                            'the path of a URDF file, or its XML') from None
        reason = error.strerror if isinstance(error, OSError) else error
        raise UrdfError(f'source: {_short_path(os.fspath(source))}: {reason}; expected '
                        'the path of a URDF file, or its XML') from None


def parse(text: str, *, depth: int = DEPTH, unread: Sequence[str] = UNREAD) -> Element:
    """
    Parse XML and return the root element, to a depth and without `unread` elements.

    The parser ignores namespaces, as the parsers of ROS do, because real files use
    undeclared prefixes.
    """
    try:
        data = text.encode()
    except UnicodeEncodeError as error:
        raise UrdfError(f'text: lone surrogate {text[error.start]!r}; expected '
                        'Unicode text') from None
    parser = expat.ParserCreate('utf-8')
    top = Element('', {}, 0)
    path = [top]  # the open elements that are kept, outermost first
    level = 0
    skipped = 0  # open elements below the depth, or in one that is not read

    # Elements below the depth are counted, not kept, so that huge files stay cheap.
    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal level, skipped
        level += 1
        if skipped or level > depth:
            skipped += 1
            return
        element = Element(tag, attributes, parser.CurrentLineNumber)
        path[-1].children.append(element)
        path.append(element)
        skipped = int(tag in unread)

    def end(tag: str) -> None:
        nonlocal level, skipped
        level -= 1
        skipped = max(skipped - 1, 0)
        if not skipped and level + 1 < len(path):
            path.pop()

    # Unsafe XML: expat calls this at <!DOCTYPE, before it reads any declaration inside.
    def refuse_doctype(name: str, *_: object) -> None:
        raise UrdfError(f'XML: declaration <!DOCTYPE {name[:60]}> (line '
                        f'{parser.CurrentLineNumber}); expected no document type or '
                        'entity declarations')

    parser.StartDoctypeDeclHandler = refuse_doctype
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        expected = 'well-formed XML'
        if error.code == expat.errors.codes[expat.errors.XML_ERROR_MISPLACED_XML_PI]:
            expected = '<?xml ...?> before all else, also before comments'
        raise UrdfError(f'XML: {error}, near {_near(data, parser.ErrorByteIndex)}; '
                        f'expected {expected}') from None
    return top.children[0]


def rebuilt(root: Element, tags: dict[str, tuple[str, ...]]) -> bytes:
    """
    Return XML of `root` with only the children that `tags` lists for each tag.

    Prefixes and namespaces are removed: yourdfpy finds no elements in a default
    namespace.
    """
    def copy(element: Element) -> ElementTree.Element:
        # Attributes with a namespace mean nothing to the reader of URDFs.
        attributes = {name: value for name, value in element.attributes.items()
                      if ':' not in name and name != 'xmlns'}
        duplicate = ElementTree.Element(element.tag, attributes)
        for child in element.children:
            if child.tag in tags.get(element.tag, ()):
                duplicate.append(copy(child))
        return duplicate
    text: bytes = ElementTree.tostring(copy(root), encoding='utf-8',
                                       xml_declaration=True)
    return text


def _decode(data: bytes, what: str = 'XML') -> str:
    """Decode XML bytes by byte order mark, declared encoding, or UTF-8; `what` names them."""
    name = _encoding(data)
    of_a_mark = name == 'utf-8-sig' or re.fullmatch(r'utf-(16|32)-[bl]e', name)
    if not of_a_mark and not ENCODINGS.fullmatch(name):
        raise UrdfError(f"{what}: encoding '{name}'; expected UTF-8, UTF-16, UTF-32, "
                        'US-ASCII, ISO-8859-x or windows-125x')
    try:
        return data.decode(name)
    except (UnicodeError, LookupError) as error:
        raise UrdfError(f'{what}: not {name} text: {error}; expected XML in its declared '
                        'encoding, or UTF-8') from None


def _encoding(data: bytes) -> str:
    """Return the encoding of XML by its byte order mark or its declaration."""
    for mark, name in BOMS:
        if data.startswith(mark):
            return name
    declared = ENCODING.match(data)
    return declared[1].decode() if declared else 'utf-8'


def _short_path(path: str) -> str:
    """Return the quoted path; of a long one the end, with the file name."""
    if len(path) > 120:
        path = f'...{path[-100:]}'
    return repr(path)


def _near(data: bytes, at: int) -> str:
    """Return the quoted bytes around an index."""
    excerpt = data[max(at - 20, 0):max(at, 0) + 20]
    return repr(excerpt.decode('utf-8', 'replace'))
