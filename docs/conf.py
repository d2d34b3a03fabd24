"""How these pages become a site: ``./run docs``."""

project = "armsight"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "contents"
html_theme = "furo"
html_title = "armsight"
html_show_copyright = False
myst_heading_anchors = 3
# Pages link to files of the repository (a workcell, a script) that are no pages of the site.
suppress_warnings = ["myst.xref_missing"]
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
add_module_names = False
