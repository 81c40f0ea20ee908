"""How the pages become a site: `python -m sphinx -W -b html docs build/docs`, without a network, in half a minute."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

import icpmodel

project = "icpmodel"
author = copyright = "the icpmodel developers"
release = icpmodel.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",  # docstrings in numpydoc sections, before those in the older form
    "sphinx.ext.viewcode",
    "myst_parser",
    "sphinx_copybutton",
    "house_style",  # docstrings and names in backticks, as this house writes them
    "mathml",  # formulas that browsers set themselves
    "gallery",  # the pages of examples/
]
exclude_patterns = ["_extensions"]
linkcheck_ignore = [r"^\w+\.html$"]  # of the cards of the gallery, which are made with the pages they lead to
nitpicky = False  # annotations name what is no page; links in the text are all checked

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_inline", "attrs_block"]
myst_heading_anchors = 3

napoleon_use_ivar = True  # a list of attributes: those that are properties have an entry of their own
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False  # what a method overrides is told where it is introduced
python_maximum_signature_line_length = 90
toc_object_entries_show_parents = "hide"
add_module_names = False
viewcode_line_numbers = False

html_theme = "furo"
html_title = "icpmodel"
html_static_path = ["_static"]
html_css_files = ["house.css"]
html_copy_source = html_show_sourcelink = False
pygments_style = "default"  # all of its text is 4.5 : 1 or more, as that of the other
pygments_dark_style = "monokai"
html_theme_options = {"navigation_with_keys": True}
copybutton_prompt_text, copybutton_prompt_is_regexp = r">>> |\.\.\. |\$ ", True
copybutton_copy_empty_lines = False
