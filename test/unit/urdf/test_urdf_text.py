"""Text of a URDF: encodings, sizes, and input that is rejected before parsing."""

from pathlib import Path

from kane_dynamics.errors import InputError, KaneError, UrdfError
from kane_dynamics.urdf import load_urdf
import pytest
from urdf_writer import chain, joint, link, load, load_with_warnings, robot

NAME = 'Gelenk-äöü-関節'
TEXT = robot(link('a'), link('b'), joint(NAME, 'a', 'b'))


@pytest.mark.parametrize('codec', ['utf-8', 'utf-8-sig', 'utf-16', 'utf-16-le',
                                   'utf-16-be', 'utf-32', 'utf-32-le', 'utf-32-be'])
@pytest.mark.parametrize('declared', [True, False])
def test_unicode_encodings_load_and_names_are_kept(codec, declared):
    family = codec.removesuffix('-sig').removesuffix('-le').removesuffix('-be').upper()
    head = f'<?xml version="1.0" encoding="{family}"?>' if declared else ''
    assert load((head + TEXT).encode(codec)).joint_names == (NAME,)


def test_declared_single_byte_encoding_is_used():
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>' + TEXT.replace(NAME, 'é')
    assert load(text.encode('latin-1')).joint_names == ('é',)


def test_declaration_in_a_str_does_not_matter():
    assert load(
        '\ufeff<?xml version="1.0" encoding="UTF-16"?>' + TEXT).joint_names == (NAME,)


def test_path_as_str_and_as_path(tmp_path):
    path = tmp_path / 'arm.urdf'
    path.write_text(TEXT, encoding='utf-8')
    assert load(path).digest() == load(str(path)).digest() == load(TEXT).digest()


def test_names_are_kept_exactly():
    name = " a  b&lt;&quot;&amp;'/:."
    model = load(robot(link('a'), link('b'), joint(name, 'a', 'b')))
    assert model.joint_names == (' a  b<"&\'/:.',)


@pytest.mark.parametrize(('source', 'words'), [
    (TEXT.encode('latin-1', 'replace')[:40] + b'\xff\xfe', ('utf-8', 'valid')),
    (b'<?xml version="1.0" encoding="utf-7"?><robot/>', ("'utf-7'", 'UTF-8, UTF-16')),
    (b'<?xml version="1.0" encoding="rot13"?><robot/>', ("'rot13'", 'UTF-8, UTF-16')),
    ('<robot name="\ud800"/>', ('surrogate', 'Unicode')),
    ('', ('empty text', 'path of a URDF')),
    ('/nowhere/arm.urdf', ("'/nowhere/arm.urdf'", 'no such file', 'path of a URDF')),
    ('arm\0.urdf', ('null', 'path of a URDF')),
    ('robot ' * 1000, ('path of a URDF', '...')),
    (Path('/'), ("'/'", 'directory', 'path of a URDF')),
])
def test_unreadable_source_is_rejected_with_its_reason(source, words):
    with pytest.raises(UrdfError) as caught:
        load_urdf(source)
    for word in words:
        assert word in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize('source', [None, 5, ['a'], object])
def test_source_of_another_type_is_refused(source):
    with pytest.raises(InputError, match=r'source: .*; expected a path, or the XML'):
        load_urdf(source)


def test_an_empty_file_is_named(tmp_path):
    path = tmp_path / 'empty.urdf'
    path.write_text(' \n')
    with pytest.raises(UrdfError,
                       match=r"source: '.*empty\.urdf': an empty file; expected a URDF"):
        load_urdf(path)


def test_a_file_that_is_no_text_is_named(tmp_path):
    path = tmp_path / 'arm.urdf'
    path.write_bytes(b'<robot name="\xff"/>')
    with pytest.raises(UrdfError, match=r"source: '.*arm\.urdf': not utf-8 text: "):
        load_urdf(path)


BOMB = ('<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'
        '<robot name="&b;"><link name="a"/></robot>')
DECLARATIONS = {
    'doctype': '<!DOCTYPE robot><robot name="r"><link name="a"/></robot>',
    'entities': BOMB, 'file entity': '<!DOCTYPE r [<!ENTITY f SYSTEM '
    '"file:///etc/passwd">]><robot name="&f;"/>', 'parameter entity': '<!DOCTYPE r '
    '[<!ENTITY % p SYSTEM "http://x/"> %p;]><robot name="r"/>',
    'behind an instruction that looks like a comment':
        '<?x <!-- ?><!DOCTYPE r [<!ENTITY b "x">]><robot name="&b;"><link name="a"/>'
        '</robot>',
    'lower case': '<!doctype robot><robot name="r"><link name="a"/></robot>',
    'behind a comment': '<?xml version="1.0"?><!-- --><?x y?> <!DOCTYPE r><robot '
    'name="r"/>', 'inside': '<robot name="r"><!ENTITY a "b"></robot>',
}


@pytest.mark.parametrize('name', DECLARATIONS)
@pytest.mark.parametrize('codec', ['utf-8', 'utf-16', 'utf-32-be'])
def test_declarations_are_refused_in_any_encoding(name, codec):
    with pytest.raises(UrdfError,
                       match=r'XML: .*; expected (no document type or|well-formed XML)'):
        load_urdf(DECLARATIONS[name].encode(codec))


def test_declaration_in_a_comment_is_a_comment():
    load('<!-- <!DOCTYPE r> <!ENTITY a "b"> --><robot name="r"><link name="a"/></robot>')


def test_undeclared_entity_is_refused():
    with pytest.raises(UrdfError, match='undefined entity'):
        load_urdf('<robot name="r"><link name="&a;"/></robot>')


def test_undeclared_prefixes_and_odd_visuals_are_ignored():
    model = load(
        '<robot name="r"><link name="a"><visual><geometry><torus/></geometry></visual>'
        '<collision/></link><sensor:camera/><gazebo><controller:x a:b="c"/></gazebo>'
        '</robot>')
    assert [frame.name for frame in model.frames] == ['a']


def test_namespaces_do_not_hide_the_robot():
    model = load(TEXT.replace('<robot', '<robot xmlns="http://www.ros.org" x:y="z" '
                              'xmlns:xacro="http://wiki.ros.org/xacro"'))
    assert model.joint_names == (NAME,)


def test_meshes_are_never_opened():
    mesh = ('<geometry><mesh filename="package://nowhere/x.dae" scale="a b '
            'c"/></geometry>')
    load(robot(
        f'<link name="a"><visual>{mesh}</visual><collision>{mesh}</collision></link>'))


@pytest.mark.parametrize('links', [1000, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize('kind', ['revolute', 'fixed'])
def test_long_chain_loads(kind, links):
    model = load(chain(links, kind))
    assert (model.n, len(model.frames)) == (links if kind == 'revolute' else 0,
                                            links + 1)


def test_long_chain_of_mimics_resolves():
    n = 1000
    follow = [joint(f'j{i}', f'l{i - 1}', f'l{i}', limit='',
                    more=f'<mimic joint="j{i + 1}" offset="1"/>') for i in range(1, n)]
    source = robot(*(link(f'l{i}') for i in range(n + 1)), *follow,
                   joint(f'j{n}', f'l{n - 1}', f'l{n}'))
    model = load(source)
    assert model.joint_names == (f'j{n}',)
    assert model.bodies[0].joint.offset == n - 1


DEEP = {
    'unknown elements': '<robot name="r"><link name="a">' + '<x>' * 100_000
    + '</x>' * 100_000 + '</link></robot>',
    'links in links': '<robot name="r"><link name="a">' + '<link name="b">' * 100_000
    + '</link>' * 100_000 + '</link></robot>',
    'visuals': '<robot name="r"><link name="a"><visual>' + '<y>' * 100_000
    + '</y>' * 100_000 + '</visual></link></robot>',
}


@pytest.mark.parametrize('name', DEEP)
def test_deep_xml_loads(name):
    model, _ = load_with_warnings(DEEP[name])
    assert [frame.name for frame in model.frames] == ['a']


@pytest.mark.parametrize('source', [
    '<a>' * 100_000 + '</a>' * 100_000, '<robot name="r">' + '<link name="a">' * 100_000,
    '<!--' * 200_000, '<robot name="r">'
    + ''.join(f'<link name="a{i}"/>' for i in range(20_000)) + '</robot>',
    '<robot name="r">' + '<link name="a"/>' * 20_000 + '</robot>',
    '<robot name="' + 'n' * 11_000_000 + '"><link name="a"/></robot>',
], ids=['deep root', 'unclosed', 'comments', 'roots', 'duplicates', 'name'])
def test_absurd_input_is_rejected_with_its_reason(source):
    with pytest.raises(KaneError) as caught:
        load_urdf(source)
    assert len(str(caught.value)) < 1000
