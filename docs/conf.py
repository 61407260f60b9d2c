"""The documentation site: `make docs` builds it offline, and warnings are errors."""

from pathlib import Path
import sys
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'docs' / 'extensions')]
package = ElementTree.parse(ROOT / 'package.xml').getroot()

project = 'kane_dynamics'
author = package.findtext('maintainer')
release = package.findtext('version')
html_title = f'{project} {release}'

extensions = ['sphinx.ext.autodoc', 'sphinx.ext.autosummary', 'sphinx.ext.viewcode',
              'numpydoc', 'myst_parser', 'sphinx_copybutton', 'mathml', 'generated']
html_theme = 'furo'
html_static_path = ['static']
html_css_files = ['site.css']
html_search_scorer = str(ROOT / 'docs' / 'static' / 'search_scorer.js')
html_math_renderer = 'mathml'  # the browser's own: no script, nothing to fetch
html_show_sphinx = html_show_copyright = False
html_copy_source = False
exclude_patterns = ['extensions', 'dev']

nitpicky = True
# A word in single quotes in a docstring is a link if it can be one: it may be an
# argument's name.
nitpick_ignore_regex = [('py:obj', '.*')]
highlight_language = 'none'  # of formulas in docstrings; blocks of pages name theirs
default_role = 'autolink'  # `Robot` in a docstring is a link where it is a name
toc_object_entries_show_parents = 'hide'
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'  # numpydoc's sections say more: shape and unit
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

myst_enable_extensions = ['dollarmath', 'fieldlist']
myst_heading_anchors = 3
copybutton_prompt_text = '$ '
copybutton_copy_empty_lines = False
copybutton_line_continuation_character = '\\'
