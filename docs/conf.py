"""Settings of the documentation: `sphinx-build -W --keep-going -b html docs OUT`."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

from gauss2svg import __version__  # noqa: E402 (found by the line above)

project = "gauss2svg"
author = "The gauss2svg developers"
release = version = __version__
html_title = project

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "docstrings",
    "packages",
    "sample_gallery",
]
exclude_patterns = ["_ext", "_templates"]
templates_path = ["_templates"]  # the theme's search page has no heading
smartquotes = False  # docstrings quote code
nitpicky = True
# Types of other libraries, whose inventories are not fetched: a build needs no network.
nitpick_ignore_regex = [(r"py:.*", r"(?!gauss2svg).*")]

myst_enable_extensions = ["colon_fence", "fieldlist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"
python_use_unqualified_type_names = True
toc_object_entries = False

html_theme = "furo"
pygments_dark_style = "github-dark"  # the usual one underlines names of modules
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_favicon = "_static/favicon.svg"
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
