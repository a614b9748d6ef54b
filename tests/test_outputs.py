"""Nothing is lost: no output replaces an input, and what is written is written whole."""

import errno
import os
import stat
from pathlib import Path

import click
import numpy as np
import pytest

from romsindy import ReducedModel, save_decay
from romsindy.commands import results
from romsindy.commands.main import main
from romsindy.commands.outputs import Output, WritingCommand
from romsindy.record.files.save import whole, write_whole
from romsindy.show.page import Picture

COMMANDS = {name: main.get_command(None, name) for name in main.list_commands(None)}
# Inputs of each command beside the one in question, so that parsing ends.
NEEDED = {"export": ["--to", "c"], "diagnose": ["--measured", "other.csv"]}


def options_of(command, output):
    """Parameters that name files: those to be written, or those to be read."""
    return [
        p
        for p in command.params
        if isinstance(p.type, click.Path)
        and p.type.file_okay
        and isinstance(p.type, Output) == output
    ]


def words(param, path):
    return [str(path)] if isinstance(param, click.Argument) else [param.opts[0], str(path)]


def kind_of(param):
    return param.type.kinds[0] if param.type.kinds else ".csv"


PAIRS = [
    pytest.param(name, i, o, id=f"{name} {i.name} {o.name}")
    for name, command in COMMANDS.items()
    for i in options_of(command, output=False)
    for o in options_of(command, output=True)
]


def test_every_option_that_writes_is_known():
    """By the type of the option; the pairs above are made of them."""
    assert len(PAIRS) > 25
    for name, command in COMMANDS.items():
        writes = {p.name for p in command.params} & {
            *("report", "json_file", "csv_file", "save", "model", "figure", "output")
        }
        known = {p.name for p in options_of(command, output=True)}
        assert writes <= known, name
        assert isinstance(command, WritingCommand) or name in ("app", "example")


WAYS = ["path", "symlink", "hard link", "spelling", "absolute", "case", "process"]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("name", "source", "output"), PAIRS)
def test_no_output_replaces_an_input(run, tmp_path, name, source, output, way):
    """Refused before the work, whatever stands in the file: nothing is read."""
    ending = kind_of(output)
    path = tmp_path / f"input{ending}"
    path.write_text("kept")
    (tmp_path / "other.csv").write_text("other")
    (tmp_path / "folder").mkdir()
    other = Path(f"link{ending}")
    if way == "symlink":
        other.symlink_to(path)
    elif way == "process" and not Path("/proc/self/cwd").exists():
        pytest.skip("this system has no /proc")
    elif way == "hard link":
        os.link(path, other)
    else:
        other = {
            "path": Path(path.name),
            "spelling": Path("folder") / ".." / path.name,
            "absolute": path,
            "case": Path(path.name.upper()),
            "process": Path("/proc/self/cwd") / path.name,
        }[way]
    others = [p for p in COMMANDS[name].params if isinstance(p, click.Argument) and p.required]
    result = run(
        name,
        *NEEDED.get(name, []),
        *["other.csv" for p in others if p not in (source, output)],
        *words(source, path.name),
        *words(output, other),
        "--overwrite",
    )
    assert result.exit_code == 2 and "no output replaces an input" in result.stderr, result.stderr
    assert path.read_text() == "kept" and other.exists() == (way != "case")


@pytest.mark.parametrize(
    ("arguments", "page"),
    [
        (["inspect", "FILE"], "a_inspection.html"),
        (["identify", "FILE"], "a_report.html"),
        (["identify", "FILE", "a_report.html"], "a_report.html"),
        (["identify", "FILE", "b.csv"], "identify_overview.html"),
        (["regress", "FILE"], "a_regression.html"),
        (["diagnose", "--model", "m.json", "--measured", "FILE"], "a_diagnosis.html"),
    ],
)
def test_pages_with_names_of_their_own_replace_nothing(run, tmp_path, arguments, page):
    """Not a file that somebody else wrote, and not an input that has such a name, nor a link."""
    for name in ("a.csv", "b.csv", "m.json"):
        (tmp_path / name).write_text("kept")
    (tmp_path / page).write_text("kept")
    result = run(*(a.replace("FILE", "a.csv") for a in arguments))
    words = "is the input" if page in arguments else "exists, and romsindy"
    assert result.exit_code == 2 and words in result.stderr
    (tmp_path / page).unlink()
    (tmp_path / page).symlink_to("a.csv")
    result = run(*(a.replace("FILE", "a.csv") for a in arguments), "--overwrite")
    assert result.exit_code == 2 and "no output replaces an input" in result.stderr
    assert (tmp_path / "a.csv").read_text() == "kept"


@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect", "a.csv", "--report", "x.html", "--json", "x.html"],
        ["inspect", "a.csv", "--json", "a_inspection.html"],
        ["identify", "a.csv", "--model", "x.json", "--save", "./x.json"],
        ["identify", "a.csv", "--model", "x.json", "--save", "X.json"],
        ["identify", "a.csv", "b.csv", "--report", "a_report.html"],
        ["identify", "x/a.csv", "y/a.csv", "x_a.csv.csv"],
        ["diagnose", "--measured", "a.csv", "--model", "m.json", "--json", "x", "--csv", "x"],
    ],
)
def test_two_outputs_never_share_a_file(run, tmp_path, arguments):
    (tmp_path / "a.csv").write_text("kept")
    (tmp_path / "m.json").write_text("kept")
    result = run(*arguments)
    assert result.exit_code == 2 and "are one file" in result.stderr, result.stderr
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "m.json"}


def test_a_file_is_replaced_by_what_made_it_or_where_that_is_asked(run, tmp_path):
    """A model as C over itself, but not over something else."""
    (tmp_path / "m.json").write_text('{"coefficients": {"omega^2": 36.0}}')
    export = ["export", "m.json", "--to", "matlab", "--output", "m.m"]
    assert run(*export).exit_code == 0
    first = (tmp_path / "m.m").read_text()
    assert run(*export).exit_code == 0 and (tmp_path / "m.m").read_text() == first
    (tmp_path / "m.m").write_text("by hand")
    result = run(*export)
    assert result.exit_code == 2 and "overwrite it with --overwrite" in result.stderr
    assert (tmp_path / "m.m").read_text() == "by hand"
    assert run(*export, "--overwrite").exit_code == 0 and (tmp_path / "m.m").read_text() == first
    result = run(*export, "--force")
    assert result.exit_code == 2 and "files are overwritten with --overwrite" in result.stderr


def test_every_kind_of_output_knows_itself(run, tmp_path):
    """What a command wrote it may write again; another option of it may not."""
    model = ReducedModel.from_coefficients({"omega^2": 1480.0, "c_linear": 0.5}, unit="m")
    save_decay(model.simulate(0.05, 0.0, np.arange(0, 8, 0.01)), tmp_path / "decay.csv")
    written = [
        "--json",
        "r.json",
        "--model",
        "f.json",
        "--figure",
        "f.png",
        "--report",
        "page.html",
    ]
    result = run("regress", "decay.csv", *written)
    assert result.exit_code == 0, result.output
    assert ReducedModel.from_json((tmp_path / "f.json").read_text()).coefficients["omega^2"]
    for ending in ("pdf", "svg"):
        Picture("backbone", "", "", lambda figure: figure.subplots()).write(
            tmp_path / f"f.{ending}"
        )
    for known in (written, ["--figure", "f.pdf"], ["--figure", "f.svg"]):
        result = run("regress", "missing.csv", *known)
        assert "missing.csv: no such file" in result.stderr
    for taken in ("r.json", "f.png", "page.html"):
        result = run("identify", "decay.csv", "--save", taken)
        assert result.exit_code == 2 and "did not write it there before" in result.stderr


@pytest.mark.parametrize("name", ["beam.csv", "beam.npz"])
def test_a_simulation_is_written_again(run, tmp_path, name):
    for _ in range(2):
        result = run("simulate", name, "--elements", 2, "--duration", 0.01, "--quiet")
        assert result.exit_code == 0, result.output
    (tmp_path / name).write_text("t,q")
    result = run("simulate", name, "--elements", 2, "--duration", 0.01, "--quiet")
    assert result.exit_code == 2 and "did not write it there before" in result.stderr


def test_the_study_takes_no_folder_of_others(run, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "report.html").write_text("kept")
    result = run("study", "--out", "mine", "--quick")
    assert result.exit_code == 2 and "name another folder" in result.stderr
    assert (tmp_path / "mine" / "report.html").read_text() == "kept"


# -- written whole --------------------------------------------------------------------------------


@pytest.mark.parametrize("failure", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_what_fails_leaves_the_old_file(tmp_path, failure):
    path = tmp_path / "old.txt"
    path.write_text("old")
    with pytest.raises(type(failure)), whole(path) as new:
        new.write_text("half of the n")
        raise failure
    assert path.read_text() == "old" and [*tmp_path.iterdir()] == [path]


def test_what_cannot_be_moved_is_kept_and_named(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    path = tmp_path / "old.txt"
    path.write_text("old")
    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(OSError, match="is whole in") as caught:
        write_whole(path, "new")
    assert path.read_text() == "old" and caught.value.filename == str(path)
    new = next(p for p in tmp_path.iterdir() if p != path)
    assert new.read_text() == "new" and str(new) in caught.value.strerror


def test_permissions_and_links_stay(tmp_path):
    path, link = tmp_path / "old.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    write_whole(link, "new")
    assert link.is_symlink() and path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    umask = os.umask(0o027)
    try:
        write_whole(tmp_path / "fresh.txt", "new")
    finally:
        os.umask(umask)
    assert stat.S_IMODE((tmp_path / "fresh.txt").stat().st_mode) == 0o640


def test_streams_are_written_as_they_are(run, tmp_path):
    (tmp_path / "m.json").write_text('{"coefficients": {"omega^2": 36.0}}')
    result = run("export", "m.json", "--to", "c", "--output", "/dev/null")
    assert result.exit_code == 0 and not os.path.isfile("/dev/null")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_whole(pipe, "through")
    assert os.read(reader, 100) == b"through" and stat.S_ISFIFO(pipe.stat().st_mode)
    os.close(reader)


@pytest.mark.parametrize(
    ("failure", "code", "why"),
    [(OSError(errno.ENOSPC, "No space left on device"), 2, "No space left"),
     (KeyboardInterrupt(), 130, "interrupted")],
)  # fmt: skip
def test_a_page_that_fails_costs_no_result(run, tmp_path, monkeypatch, failure, code, why):
    """The result is printed, the old page stays, and the message names the new one."""
    model = ReducedModel.from_coefficients({"omega^2": 1480.0, "c_linear": 0.5}, unit="m")
    save_decay(model.simulate(0.05, 0.0, np.arange(0, 8, 0.01)), tmp_path / "decay.csv")

    def fail(*_, **__):
        raise failure

    monkeypatch.setattr(results, "write_result", fail)
    (tmp_path / "page.html").write_text("old")
    result = run("regress", "decay.csv", "--report", "page.html", "--overwrite",
                 "--full", "--model", "m.json")  # fmt: skip
    assert result.exit_code == code and "omega^2" in result.stdout
    assert "Report: not written" in result.stdout and "Model: m.json" in result.stdout
    assert f"page.html was not written: {why}" in result.stderr
    assert (tmp_path / "page.html").read_text() == "old" and (tmp_path / "m.json").exists()
