"""The pictures of the gallery, drawn by their scripts: ``python docs/gallery.py``.

A script is one file of ``docs/gallery/``. The first paragraph of its docstring is the caption of
its picture, the second one tells what is seen to who does not see it.
"""

from __future__ import annotations

import ast
import runpy
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

HERE = Path(__file__).parent
SCRIPTS, PICTURES = HERE / "gallery", HERE / "pictures"
# In the order of the page: the title of each, and the page that says more.
CONTENTS = {
    "inspection": ("What is in a record", "howto/inspect.md"),
    "backbone": ("One backbone", "howto/identify.md"),
    "damping": ("Damping against amplitude", "howto/identify.md"),
    "functions": ("Inertia and stiffness", "howto/identify.md"),
    "forecast": ("A decay foretold", "refinement.md"),
    "comparison": ("Stiffness alone, or inertia too", "regression.md"),
    "laws_of_damping": ("Laws of damping", "effects.md"),
    "hysteresis": ("A joint that slips", "effects.md"),
    "diagnosis": ("What a simulation lacks", "howto/diagnose.md"),
    "forced_response": ("Folds of a forced response", "howto/orbits.md"),
    "stepped_sine": ("The next level foretold", "howto/steady.md"),
    "shaker": ("On a shaker", "howto/forced.md"),
    "two_modes": ("Two modes exchange energy", "howto/several.md"),
    "tongue": ("A backbone turns aside", "howto/orbits.md"),
    "beam": ("A beam swings", "howto/beam.md"),
}


class Script(NamedTuple):
    """What is drawn, in which words, by which code."""

    path: Path
    caption: str
    seen: str
    code: str

    @classmethod
    def of(cls, name: str) -> Script:
        """The script of a picture."""
        path = SCRIPTS / f"{name}.py"
        text = path.read_text(encoding="utf-8")
        module = ast.parse(text)
        paragraphs = (ast.get_docstring(module) or "").split("\n\n")
        caption, seen = (" ".join(p.split()) for p in (*paragraphs, "", "")[:2])
        code = "\n".join(text.splitlines()[module.body[0].end_lineno :]).strip() + "\n"
        return cls(path, caption, seen, code)

    def figure(self) -> Figure:
        """Run it; the caller closes the figure that it leaves."""
        plt.close("all")
        plt.switch_backend("Agg")  # which no `plt.show()` stops
        with plt.style.context(SCRIPTS / "style.mplstyle"), warnings.catch_warnings():
            # It ends as a user's own would, by showing.
            warnings.filterwarnings("ignore", "FigureCanvasAgg is non-interactive", UserWarning)
            runpy.run_path(str(self.path))
        return plt.gcf()


def draw(name: str, folder: Path = PICTURES) -> float:
    """Write a picture, ``NAME.svg``; returns how long it took, s."""
    folder.mkdir(exist_ok=True)
    begin = time.perf_counter()
    figure = Script.of(name).figure()
    with plt.style.context(SCRIPTS / "style.mplstyle"):
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    plt.close("all")
    return time.perf_counter() - begin


def write_gallery(tell: Callable[[str], object] = lambda line: None) -> None:
    """Draw all pictures, and write the page that shows them; a line is told for each."""
    total = 0.0
    for name in CONTENTS:
        took = draw(name)
        total += took
        tell(f"{name:<16} {took:5.1f} s")
    (PICTURES / "page.md").write_text(page(), encoding="utf-8")
    tell(f"{'all':<16} {total:5.1f} s, in {PICTURES}")


def page() -> str:
    """Cards that lead to sections, and for every picture a section with its code; MyST Markdown."""
    cards = "".join(_card(name, title) for name, (title, _) in CONTENTS.items())
    sections = "".join(_section(name, *about) for name, about in CONTENTS.items())
    return f"::::{{grid}} 1 2 3 3\n:gutter: 3\n\n{cards}::::\n{sections}"


def _card(name: str, title: str) -> str:
    script = Script.of(name)
    return (
        f":::{{grid-item-card}} {title}\n:link: picture-{_dashed(name)}\n:link-type: ref\n"
        f":img-bottom: pictures/{name}.svg\n:img-alt: {script.seen}\n:::\n\n"
    )


def _section(name: str, title: str, more: str) -> str:
    script = Script.of(name)
    return (
        f"\n(picture-{_dashed(name)})=\n## {title}\n\n{script.caption}\n\n"
        f"![{script.seen}](pictures/{name}.svg)\n\n"
        f"```{{code-block}} python\n{script.code}```\n\n"
        f"[How it works]({more}); the file is `docs/gallery/{name}.py`.\n"
    )


def _dashed(name: str) -> str:
    return name.replace("_", "-")


if __name__ == "__main__":
    write_gallery(lambda line: print(line, flush=True))
