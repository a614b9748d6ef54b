"""Files that a command writes: none replaces an input, none is lost, and what fails is told last.

Every option of type `Output` is checked before the work, and so is a page with a name of its own
(`default_page`). A file that is there already is replaced where the same command made the same kind
of file before, as marks in its content say, or with ``--overwrite``.
"""

from __future__ import annotations

import json
import os
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from romsindy.commands.main import INTERRUPTED, REFUSED
from romsindy.record.files.save import is_stream, write_whole

# What a file holds that the same option of the same command wrote.
PAGE = '<meta name="generator" content="romsindy {command}">'
JSON = '"made_by": "romsindy {command} {option}"'
_PART = 1 << 16  # bytes at either end of a file, in which marks stand
_OVERWRITE, _CLAIMED, _LOST, _STOPPED = (
    f"romsindy.{x}" for x in ("overwrite", "claimed", "lost", "stop")
)


class Output(click.Path):
    """A file to be written: a place where none can be is refused before the work.

    A ``mark`` stands in a file that the same option wrote: `PAGE`, `JSON`, or a text. With
    ``allow_dash``, - is the standard output; ``kinds`` are endings that a name may have, if not
    all.
    """

    def __init__(self, mark: str, allow_dash: bool = False, kinds: Sequence[str] = ()) -> None:
        super().__init__(path_type=Path, allow_dash=allow_dash)
        self.mark, self.kinds = mark, kinds

    def convert(self, value: Any, param: Any, ctx: Any) -> Path:
        path = Path(value)
        if self.allow_dash and str(value) == "-":
            return path
        if self.kinds and path.suffix.lower() not in self.kinds:
            self.fail(f"{path}: its name must end in {' or '.join(self.kinds)}", param, ctx)
        if path.is_dir():
            self.fail(f"{path} is a folder: name a file", param, ctx)
        folder = Path(os.path.realpath(path)).parent
        if not folder.is_dir():
            self.fail(f"{path}: there is no folder {path.parent}", param, ctx)
        needed = [path] if path.exists() else []
        needed += [] if is_stream(path) else [folder]
        if not all(os.access(p, os.W_OK) for p in needed):
            self.fail(f"{path} cannot be written: choose another place", param, ctx)
        return path


class WritingCommand(click.Command):
    """A command that checks its outputs before it runs, and tells last what could not be written.

    It has the option ``--overwrite`` beside its own. Its --help lists all under ``headings``, which
    have names of options, between blanks; what is in none stands under "Other". Without any all
    stand under "Options".
    """

    def __init__(
        self, *args: Any, headings: Mapping[str, str] | None = None, **settings: Any
    ) -> None:
        super().__init__(*args, **settings)
        self.headings = headings or {}
        words = "Overwrite files that are there, whoever made them; never an input."
        self.params.append(click.Option(["--overwrite"], is_flag=True, help=words))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options heading by heading, each in the order of its names."""
        left = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        rest = "Other" if self.headings else "Options"
        for heading, names in {**self.headings, rest: ""}.items():
            own = [p for name in names.split() for p in left if name in p.opts]
            rows = [p.get_help_record(ctx) for p in (own if names else left)]
            if any(rows):
                with formatter.section(heading):
                    formatter.write_dl([row for row in rows if row is not None])
            left = [p for p in left if p not in own]

    def invoke(self, ctx: click.Context) -> None:
        """Run it; the exit code says if a file was not written."""
        ctx.meta.update({_OVERWRITE: ctx.params.pop("overwrite"), _CLAIMED: {}, _LOST: {}})
        for param in self.params:
            if isinstance(param.type, Output) and ctx.params[param.name or ""] is not None:
                _claim(ctx, _label(param), ctx.params[param.name or ""], param.type.mark)
        code = 0
        try:
            super().invoke(ctx)
        except click.exceptions.Exit as done:
            code = done.exit_code
        finally:
            for path, why in ctx.meta[_LOST].items():
                click.echo(f"Error: {path} was not written: {why}", err=True)
        if ctx.meta[_LOST]:
            code = INTERRUPTED if stopped() else REFUSED
        if code:
            raise click.exceptions.Exit(code)


def default_page(name: str, remedy: str = "name another with --report") -> Path:
    """A page of this name, where it can be written.

    Raises a UsageError if it is an input, another output, or a file that this command did not make.
    """
    ctx = click.get_current_context()
    path = Output(PAGE).convert(name, None, ctx)
    _claim(ctx, "the page", path, PAGE, remedy)
    return path


def claim_folder(folder: Path, page: str) -> None:
    """Raise a UsageError for a folder with files, unless this command wrote its page there."""
    ctx = click.get_current_context()
    if ctx.meta[_OVERWRITE] or not folder.is_dir() or not any(folder.iterdir()):
        return
    if not (folder / page).is_file() or not _holds(folder / page, PAGE, ctx):
        raise click.UsageError(
            f"the folder {folder} holds files that romsindy {ctx.info_name} did not write: name"
            " another folder, or let files of the same name be overwritten with --overwrite",
            ctx,
        )


def _claim(
    ctx: click.Context, label: str, path: Path, mark: str, remedy: str = "name another file"
) -> None:
    if str(path) == "-" or (path.exists() and not path.is_file()):
        return
    for name, file in _inputs(ctx):  # also through /proc and /dev, where all else is a stream
        if _same(path, file):
            also = "" if str(file) == str(path) else f", {file}"
            raise click.UsageError(
                f"{label} {path} is the input {name}{also}: no output replaces an input; {remedy}",
                ctx,
            )
    if is_stream(path):
        return
    for other, name in ctx.meta[_CLAIMED].items():
        if _same(path, other):
            both = f"{path}" if str(path) == str(other) else f"{path} and {other}"
            raise click.UsageError(f"{label} and {name} are one file, {both}: {remedy}", ctx)
    if path.is_file() and not ctx.meta[_OVERWRITE] and not _holds(path, mark, ctx, label):
        raise click.UsageError(
            f"{label} {path} exists, and romsindy {ctx.info_name} did not write it there before:"
            f" {remedy}, or overwrite it with --overwrite",
            ctx,
        )
    ctx.meta[_CLAIMED][path] = label


def keep_inputs(files: Mapping[str, Path]) -> None:
    """Raise a UsageError where an output is one of these files, which an input names."""
    ctx = click.get_current_context()
    for path, label in ctx.meta[_CLAIMED].items():
        for what, file in files.items():
            if _same(path, file):
                raise click.UsageError(
                    f"{label} {path} is {what}, {file}: no output replaces an input; name another"
                    " file",
                    ctx,
                )


def _inputs(ctx: click.Context) -> Iterator[tuple[str, Path]]:
    """Options and arguments that name files to be read, each with its file."""
    for param in ctx.command.params:
        kind, value = param.type, ctx.params.get(param.name or "")
        if isinstance(kind, click.Path) and kind.file_okay and not isinstance(kind, Output):
            for file in value if isinstance(value, tuple) else [value]:
                if file is not None:
                    yield _label(param), file


def _label(param: click.Parameter) -> str:
    return max(param.opts, key=len) if isinstance(param, click.Option) else str(param.name).upper()


def _same(one: Path, other: Path) -> bool:
    """Whether two paths are one file, or would be: links, spelling and case do not tell apart."""
    try:
        return os.path.samefile(one, other)
    except OSError:  # one of them is not there yet
        return _spelled(one) == _spelled(other)


def _spelled(path: Path) -> str:
    return unicodedata.normalize("NFC", os.path.realpath(path)).casefold()


def _holds(path: Path, mark: str, ctx: click.Context, option: str = "") -> bool:
    """Whether the mark of an output stands in a file."""
    wanted = mark.format(command=ctx.info_name, option=option).encode()
    with path.open("rb") as file:
        found = file.read(_PART)
        file.seek(max(path.stat().st_size - _PART, 0))
        return wanted in found + b"\n" + file.read()


# -- writing --------------------------------------------------------------------------------------


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """What cannot be written, or is interrupted, is told when the command is done."""
    ctx = click.get_current_context()
    try:
        yield
    except (OSError, KeyboardInterrupt) as error:
        why = error.strerror if isinstance(error, OSError) else "interrupted"
        ctx.meta[_STOPPED] = isinstance(error, KeyboardInterrupt)
        before = "; the file of that name is as it was" if path.exists() else ""
        ctx.meta[_LOST][path] = f"{why or error}{before}"


@contextmanager
def apart(command: str) -> Iterator[dict[Path, str]]:
    """A command in another process, which writes files too; what is lost of them, and why."""
    with click.Context(click.Command(command), info_name=command) as ctx:
        yield ctx.meta.setdefault(_LOST, {})


def lose(files: Mapping[Path, str]) -> None:
    """Tell in the end of files that could not be written elsewhere."""
    click.get_current_context().meta[_LOST].update(files)


def stopped() -> bool:
    """Whether the user interrupted the writing of a file."""
    return bool(click.get_current_context().meta.get(_STOPPED))


def told(what: str, path: Path) -> str:
    """The line that names a file, once it was written or not."""
    lost = path in click.get_current_context().meta[_LOST]
    return f"{what}: not written" if lost else f"{what}: {path}"


def write_text(path: Path, text: str) -> None:
    """Write to a file, or to the standard output for ``-``."""
    if str(path) == "-":
        click.echo(text)
        return
    with writing(path):
        write_whole(path, text + "\n")


def write_json(path: Path, text: str) -> None:
    """The same with a JSON text, which in a file says who made it."""
    ctx = click.get_current_context()
    label = ctx.meta[_CLAIMED].get(path)
    if label is not None:
        mark = {"made_by": f"romsindy {ctx.info_name} {label}"}
        content = json.loads(text)
        marked = [mark | c for c in content] if isinstance(content, list) else mark | content
        text = json.dumps(marked, indent=2)
    write_text(path, text)
