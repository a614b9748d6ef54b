"""Configuration of the documentation: ``sphinx-build -W --keep-going docs build/docs``."""

import re
import shutil
import sys
from importlib.metadata import version as version_of
from pathlib import Path
from textwrap import indent

import matplotlib.pyplot as plt
from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

from romsindy.effects import BEAM_CATALOGUE, CATALOGUE

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
from catalogue import kinds_of, page  # noqa: E402
from fingerprint import fingerprint, plot_fingerprint  # noqa: E402
from gallery import write_gallery  # noqa: E402

project = "romsindy"
author = "The romsindy developers"
version = release = version_of("romsindy")
language = "en"

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_design",
    "matplotlib.sphinxext.plot_directive",
]
exclude_patterns = ["_templates", "effects", "pictures"]
templates_path = ["_templates"]
default_role = "py:obj"  # a name in single backticks links to what it names
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # they are stored executed, and tests run them
copybutton_exclude = ".linenos, .gp, .go"

numpydoc_show_class_members = False  # autosummary lists them
autodoc_typehints = "none"  # the docstrings say more
toc_object_entries_show_parents = "hide"
autodoc_member_order = "bysource"

plot_formats = ["svg"]
plot_html_show_formats = False
plot_html_show_source_link = False
plot_rcparams = {"savefig.bbox": "tight", "figure.constrained_layout.use": True}

html_theme = "pydata_sphinx_theme"
html_title = "romsindy"
html_static_path = ["_static"]
html_css_files = ["own.css"]
html_show_sourcelink = False
_ALONE = ("start", "gallery", "effects", "validation", "pysindy", "matlab", "moving", "changelog")
html_sidebars = {name: [] for name in _ALONE}  # no pages below them to list
html_math_renderer = "mathml"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "header_links_before_dropdown": 7,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
    "footer_start": ["copyright"],
    "footer_end": [],
}
copyright = "the romsindy developers, MIT licence"


def write_effects() -> None:
    """What the page of effects includes and its pictures, from the effects themselves."""
    folder = HERE / "effects"
    folder.mkdir(exist_ok=True)
    (folder / "catalogue.md").write_text(page(), encoding="utf-8")
    for effect in kinds_of((*CATALOGUE, *BEAM_CATALOGUE)):
        found = fingerprint(effect)
        if found is None:
            continue
        figure, axes = plt.subplots(1, 2, figsize=(5.6, 2.0), layout="constrained")
        plot_fingerprint(found, axes)
        figure.savefig(folder / f"{type(effect).__name__}.svg", metadata={"Date": None})
        plt.close(figure)


def copy_notebooks() -> None:
    """Notebooks live in examples/, and Sphinx reads what is below its sources alone."""
    for notebook in (HERE.parent / "examples").rglob("*.ipynb"):
        shutil.copy(notebook, HERE / "tutorials")


_NOTEBOOK = re.compile(r"\]\((?:\.\./)+examples/(?:\w+/)?(\w+\.ipynb)\)")
_FIGURE = re.compile(r"^```python\n((?:(?!```).*\n)*)```\n<!-- figure: (.*) -->\n", re.M)


def for_the_site(app: Sphinx, name: str, source: list[str]) -> None:
    """What is plain Markdown in the repository: links to notebooks, snippets that draw a figure."""
    text = _NOTEBOOK.sub(r"](/tutorials/\1)", source[0])
    source[0] = _FIGURE.sub(_with_figure, text)


def _with_figure(found: re.Match[str]) -> str:
    code, alt = found.groups()
    plot = f".. plot::\n   :alt: {alt}\n\n{indent(code, '   ')}"
    return f"```python\n{code}```\n\n```{{eval-rst}}\n{plot}```\n"


def inline_math(writer: object, node: nodes.math) -> None:
    """MathML needs no script and no network."""
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block_math(writer: object, node: nodes.math_block) -> None:
    """An equation of its own scrolls where it is wider than the page."""
    writer.body.append(
        f'<div class="equation" tabindex="0">{convert(node.astext(), display="block")}</div>'
    )
    raise nodes.SkipNode


def foreign(app: Sphinx, what: str, name: str, member: object, skip: bool, options: object) -> bool:
    """Leave out what classes inherit from other packages."""
    return skip or not (getattr(member, "__module__", None) or project).startswith(project)


def setup(app: Sphinx) -> None:
    """Make what is made, and how equations are set."""
    write_effects()
    write_gallery()
    copy_notebooks()
    app.connect("source-read", for_the_site)
    app.connect("autodoc-skip-member", foreign)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
