"""The command ``romsindy``. Each of its commands is imported when it runs: help costs no time.

Any package that is installed adds a command of its own by an entry point of the group
``romsindy.commands``, a `click.Command`; the first line of its module's docstring stands in the
help. A name of ours stays ours.
"""

from __future__ import annotations

import ast
import sys
import warnings
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from threading import Timer
from typing import Any

import click

from romsindy import __version__
from romsindy.text import as_options, listed

_COMMANDS = {
    "diagnose": "Name what a simulation lacks, from measured vibrations, free or driven.",
    "example": "Write the files that README and docs use to DIR.",
    "export": "Write the equation of motion in FILE for MATLAB, C, sympy, AUTO or OpenFAST, or as"
    " text.",
    "identify": "Identify equations of motion from the free or driven vibrations in FILES.",
    "inspect": "Say what is in the record in FILE, what would be used, and what comes next.",
    "predict": "Foretell what the equation in FOUND does under a harmonic force, or its backbone.",
    "reduce": "Reduce the finite-element model in DECK to the equation of one mode.",
    "regress": "Fit models of a given structure to the free decays in FILES, by regression.",
    "simulate": "Simulate the free decay of the beam and write it to OUTPUT.",
    "steady": "Fit an equation of motion to the steady states in the table POINTS.",
}
OVERWRITES = "files are overwritten with --overwrite"  # what --force did
REFUSED = 2
INTERRUPTED = 130  # as a shell reports Ctrl-C


class _Refusal(click.ClickException):
    """One line on the error stream."""

    exit_code = REFUSED


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn refused input into one line and exit code 2; an internal error keeps its traceback."""
    before, sys.unraisablehook = sys.unraisablehook, partial(_again, sys.unraisablehook)
    try:
        yield
    except (click.exceptions.Exit, BrokenPipeError):  # nobody reads on: click ends quietly
        raise
    except click.UsageError as error:
        hint = f" (see '{error.ctx.command_path} --help')" if error.ctx else ""
        raise _Refusal(_one_line(_elsewhere(error) or error.format_message()) + hint) from error
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        raise _Refusal(_one_line(what)) from error
    except (ValueError, RuntimeError) as error:
        raise _Refusal(_one_line(str(error))) from error
    except KeyboardInterrupt as error:  # with what was reached, where a command says it
        click.echo(_one_line(f"Interrupted {error}".strip()) + ".", err=True)
        raise click.exceptions.Exit(INTERRUPTED) from None
    finally:
        sys.unraisablehook = before


def _again(
    otherwise: Callable[[sys.UnraisableHookArgs], Any], lost: sys.UnraisableHookArgs
) -> None:
    """Repeat a Ctrl-C that Python drops, as where it comes while an object is collected."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        Timer(0.05, interrupt_main).start()  # once what dropped it has ended
    else:
        otherwise(lost)


def _elsewhere(error: click.UsageError) -> str:
    """Which commands have an option that this one has not: nearer than one of a like name."""
    if getattr(error, "option_name", "") == "--force":  # no such option, or without a value
        return f"--force is the force of a test, such as --force 0.2; {OVERWRITES}"
    if not isinstance(error, click.NoSuchOption) or error.ctx is None:
        return ""
    have = [
        f"romsindy {name}"
        for name in (*_COMMANDS, *_added())
        if any(error.option_name in p.opts for p in _command(name).params)
    ]
    return f"{error.option_name} is no option here, but of {listed(have)}" if have else ""


@cache
def _added() -> dict[str, EntryPoint]:
    """Commands that installed packages add."""
    found = entry_points(group="romsindy.commands")
    return {entry.name: entry for entry in found if entry.name not in _COMMANDS}


def _command(name: str) -> click.Command:
    try:
        if name in _COMMANDS:
            command: click.Command = getattr(import_module(f"romsindy.commands.{name}"), name)
            return command
        return _loaded(_added()[name])
    except KeyboardInterrupt:
        raise KeyboardInterrupt("before any file was read") from None


def _loaded(entry: EntryPoint) -> click.Command:
    """The command of another package, or where it has none, one that says so."""
    try:
        command = entry.load()
    except Exception as error:
        return _without(entry, f"cannot be imported: {type(error).__name__}: {error}")
    if not isinstance(command, click.Command):
        kind = type(command).__name__
        return _without(entry, f"is no click.Command: {entry.value} is of type {kind}")
    return command


def _without(entry: EntryPoint, why: str) -> click.Command:
    package = entry.dist.name if entry.dist else entry.module
    reason = f"the command {entry.name} of the package {package} {why}; update or uninstall it"

    def refuse() -> None:
        raise _Refusal(_one_line(reason))

    anything = {"ignore_unknown_options": True, "allow_extra_args": True}
    return click.Command(entry.name, callback=refuse, help=reason, context_settings=anything)


def _line(entry: EntryPoint) -> str:
    """What the help says of another package's command, which is not imported for it."""
    try:
        spec = find_spec(entry.module)
        source = spec.loader.get_source(entry.module)  # type: ignore[union-attr]
        return str(ast.get_docstring(ast.parse(source))).partition("\n")[0]
    except Exception as error:
        return _one_line(f"cannot be imported: {type(error).__name__}: {error}")


def _one_line(message: str) -> str:
    return as_options(" ".join(message.split()))


class _Commands(click.Group):
    """Commands that are imported late and that refuse input alike."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted((*_COMMANDS, *_added()))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        return _command(name) if name in _COMMANDS or name in _added() else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            lines = _COMMANDS | {name: _line(entry) for name, entry in _added().items()}
            formatter.write_dl(sorted(lines.items()))

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        with _refusals():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        with warnings.catch_warnings(), _refusals():
            warnings.simplefilter("default", UserWarning)
            warnings.showwarning = _show_warning  # type: ignore[assignment]
            return super().invoke(ctx)


def _show_warning(message: Warning | str, *_: Any) -> None:
    click.echo(as_options(f"Note: {message}"), err=True)


@click.group(
    cls=_Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="python -m romsindy prints versions for a bug report.",
)
@click.version_option(__version__, prog_name="romsindy")
@click.pass_context
def main(ctx: click.Context) -> None:
    """Equations of motion, with nonlinear inertia, from measured free decays."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
