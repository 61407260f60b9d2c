"""Sphinx extension: formulas as MathML, which browsers draw by themselves."""

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

logger = logging.getLogger(__name__)


def drawn(node, *, as_block):
    """Return the MathML of a node; warn of what cannot be read."""
    try:
        return tex2mathml(node.astext(), as_block=as_block)
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
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})</span>')
    self.body.append(drawn(node, as_block=True))
    self.body.append('</div>\n')
    raise nodes.SkipNode


def setup(app):
    """Register the renderer, which `html_math_renderer` names."""
    app.add_html_math_renderer('mathml', (inline, None), (display, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
