"""How Sphinx makes the site. `build.py` beside it gathers the pages into one folder first."""

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

project = "Formation"
copyright = "The Formation developers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_extra"]

html_theme = "furo"
html_title = "Formation"
html_extra_path = ["_extra"]
html_css_files = ["gallery.css"]
html_static_path = ["_static"]
html_copy_source = False
html_show_sphinx = False
html_show_search_summary = False  # a page from a file cannot read the others
html_use_index = html_domain_indices = False

myst_heading_anchors = 4  # as GitHub makes them

default_role = "code"
autodoc_member_order = "groupwise"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True


def setup(app: Sphinx) -> None:
    """Let tables of the pages, for which there is no highlighting, be plain text."""
    app.add_lexer("csv", TextLexer)
