"""Sphinx extension: formulas as MathML, which browsers draw without a script."""

from html import unescape
import re
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

NAMESPACE = 'http://www.w3.org/1998/Math/MathML'
ElementTree.register_namespace('', NAMESPACE)
ENTITY = re.compile(r'&(?!(?:lt|gt|amp);)\w+;')  # of HTML, which XML does not know
logger = logging.getLogger(__name__)


def tag(name):
    """Return an element's name with its namespace, as ElementTree writes it."""
    return f'{{{NAMESPACE}}}{name}'


def with_accents(mathml):
    """Move the index of an accented symbol beside it; docutils writes it below."""
    root = ElementTree.fromstring(ENTITY.sub(lambda found: unescape(found[0]), mathml))
    for element in list(root.iter(tag('munderover'))):
        symbol, index, above = element
        if above.tag == tag('mo') and above.get('stretchy') == 'false':
            accented = ElementTree.Element(tag('mover'), accent='true')
            accented.extend([symbol, above])
            element.tag = tag('msub')
            element[:] = [accented, index]
    for element in root.iter(tag('msup')):
        if element[0].tag == tag('msub'):  # both indices beside it, one above the other
            element.tag = tag('msubsup')
            element[:] = [*element[0], element[1]]
    return ElementTree.tostring(root, encoding='unicode')


def drawn(node, *, as_block):
    """Return the MathML of a node; log a warning for a formula that cannot be read."""
    try:
        return with_accents(tex2mathml(node.astext(), as_block=as_block))
    except MathError as error:
        logger.warning('formula: %s', error, location=node)
        return ''


def inline(self, node):
    """Write a formula in a line of text."""
    self.body.append(drawn(node, as_block=False))
    raise nodes.SkipNode


def display(self, node):
    """Write a formula of its own, with its number at the right where it has one."""
    self.body.append(self.starttag(node, 'div', CLASS='math'))
    if node['number']:
        self.body.append(
            f'<span class="eqno">({get_node_equation_number(self, node)})</span>')
    self.body.append(drawn(node, as_block=True))
    self.body.append('</div>\n')
    raise nodes.SkipNode


def setup(app):
    """Register the renderer, which `html_math_renderer` names."""
    app.add_html_math_renderer('mathml', (inline, None), (display, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
