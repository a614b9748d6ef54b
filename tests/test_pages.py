"""Every command and snippet of README and docs runs as it stands, page by page, in order.

A page is one Python session, into which snippets are pasted line by line, and one shell, in a
folder that `romsindy example` made. What is in a fence of another kind than ```sh and ```python is
not run; a fence ```text right below one of these is what it prints.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
from code import InteractiveConsole
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from click.testing import CliRunner

from romsindy.commands.main import main

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(sh|python)\n(.*?)^```$(?:\n```text\n(.*?)^```$)?", re.S | re.M)
NUMBER = re.compile(r"(?<![\w^])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?\b")
# Commands that are not run here, and why.
ELSEWHERE = {
    r"python3? -m venv .*|\S*python -m pip .*|pip install .*": "tests need no other environment",
    r"\. \S*/activate": "the commands are those of this environment",
    r"\S*python -m pytest": "this is it: .ci/run takes it from the README",
    r"\S*romsindy study( --quick)?": "a minute or more: tests/test_study.py runs it in small",
}


def fences(page):
    """Kind and text of each fence that is to be run, what it prints, and its line."""
    text = page.read_text(encoding="utf-8")
    found = FENCE.finditer(text)
    return [(f[1], f[2], f[3] or "", text.count("\n", 0, f.start()) + 2) for f in found]


WITH_FENCES = [p for p in PAGES if fences(p)]


def commands(text):
    """Commands of a shell script without branches: continued lines joined, chains taken apart."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        while words:
            end = words.index("&&") if "&&" in words else len(words)
            yield words[:end]
            words = words[end + 1 :]


def run_command(words):
    line = shlex.join(words)
    if any(re.fullmatch(pattern, line) for pattern in ELSEWHERE):
        return
    if words[0] == "cd":
        os.chdir(words[1])
        return
    assert words[0] == "romsindy", f"no way to run {line!r}: use romsindy, or another kind of fence"
    result = CliRunner().invoke(main, words[1:])
    print(result.output)
    assert result.exit_code == 0, line


class Session(InteractiveConsole):
    """A plain Python session; what it would show as a traceback is raised."""

    def paste(self, text):
        for line in [*text.splitlines(), ""]:
            more = self.push(line)
        assert not more, f"not complete: {text}"

    def showsyntaxerror(self, *_, **__):
        raise

    def showtraceback(self):
        raise


def assert_printed(shown, printed):
    """What a page shows was printed, in order and in other spaces; "..." stands for a part of it.

    Numbers may differ by a tenth: the last digits of a fit are those of the machine.
    """
    words, place = " ".join(printed.split()), 0
    for part in shown.split("..."):
        wanted = " ".join(part.split())
        texts = NUMBER.split(wanted)
        found = re.compile(f"({NUMBER.pattern})".join(map(re.escape, texts))).search(words, place)
        assert found, f"not printed: {wanted}"
        numbers = [float(n) for n in NUMBER.findall(wanted)]
        assert [float(n) for n in found.groups()] == pytest.approx(numbers, rel=0.1), wanted
        place = found.end()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages") / "example"
    assert CliRunner().invoke(main, ["example", str(folder)]).exit_code == 0
    return folder


QUICK = ("orbits.md",)
DEAR = ("diagnose.md", "forced.md", "several.md", "simulator.md")
RUN = [
    pytest.param(
        p,
        marks=[
            *[pytest.mark.slow] * (p.name not in QUICK),
            *[pytest.mark.study] * (p.name in DEAR),
        ],
    )
    for p in WITH_FENCES
]


@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive:UserWarning")
@pytest.mark.parametrize("page", RUN, ids=lambda p: str(p.relative_to(ROOT)))
def test_page_runs_as_it_stands(page, made, tmp_path, monkeypatch, capsys):
    shutil.copytree(made, tmp_path / "example")
    monkeypatch.chdir(tmp_path / "example")
    session = Session(filename=str(page))
    for kind, text, shown, line in fences(page):
        files = {*Path().iterdir()}
        if kind == "sh":
            for words in commands(text):
                run_command(words)
        else:
            session.paste(text)
        printed = capsys.readouterr().out
        assert_printed(shown, printed)
        seen = printed.strip() or plt.get_fignums() or {*Path().iterdir()} - files
        assert seen or text.startswith((". ", "python3")), f"line {line} shows nothing: {text}"
        plt.close("all")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_what_is_shown_of_the_model_is_in_its_file(page, made):
    shown = re.findall(r"^```json\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M)
    for text in shown:
        assert json.loads(text) == json.loads((made / "model.json").read_text())
    assert shown or page.name != "diagnose.md"


def test_pages_are_found_and_taken_apart():
    assert ROOT / "README.md" in WITH_FENCES
    text = "a b && c 'd && e'  # f && g\nh \\\n  i\n"
    assert list(commands(text)) == [["a", "b"], ["c", "d && e"], ["h", "i"]]
    with pytest.raises(AssertionError, match="no way to run 'make docs'"):
        run_command(["make", "docs"])
    assert_printed("a 1.01\n...\n| 2e-3 q^2", "a  1 b c | 0.002 q^2")
    for shown in ("a 2", "c ... a", "a 1 q^2 ..."):
        with pytest.raises(AssertionError):
            assert_printed(shown, "a 1 b c")


def test_links_lead_somewhere_in_a_clone():
    """Not to what only the build of the docs makes."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("this is no clone: nothing says which files are in one")
    there = {ROOT / name for name in listed.stdout.splitlines()}
    links = 0
    for page in PAGES:
        if page not in there:
            continue
        for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in link:
                assert (page.parent / link).resolve() in there, f"{page}: {link}"
                links += 1
    assert links > 10


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120
