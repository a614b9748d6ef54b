"""Open a page in the browser: drop a record, identify, compare, take the results along."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
import webbrowser
from importlib.util import find_spec
from pathlib import Path

import click

from romsindy.commands.options import FILE

_HERE = "127.0.0.1"  # nobody else is let in
_PATIENCE = 30.0  # s, for the server to answer


@click.command()
@click.argument("file", required=False, type=FILE)
@click.option("--port", type=click.IntRange(1, 65535), help="Port on this machine.  [default: any]")
@click.option("--no-browser", is_flag=True, help="Print the address, and open nothing.")
def app(file: Path | None, port: int | None, no_browser: bool) -> None:
    """Open a page in the browser: drop a record, identify, compare, take the results along.

    It runs on this machine only, with a token in its address, reads what is dropped there or named
    here, and works without a network. Ctrl-C ends it. It needs the extra romsindy[app].
    """
    if find_spec("marimo") is None:
        raise click.UsageError('the page needs marimo: run pip install "romsindy[app]" first')
    port = _free_port(port)
    token = secrets.token_urlsafe(16)
    address = f"http://{_HERE}:{port}?access_token={token}"
    with tempfile.TemporaryDirectory(prefix="romsindy-") as folder:
        kept = Path(folder) / "token"  # of a command line every user of the machine can read
        kept.touch(mode=0o600)
        kept.write_text(token)
        words = [
            sys.executable,
            "-m",
            "marimo",
            "-q",
            "run",
            str(Path(__file__).with_name("page.py")),
        ]
        words += ["--headless", "--host", _HERE, "--port", str(port)]
        words += ["--token", "--token-password-file", str(kept)]
        words += [] if file is None else ["--", "--file", str(file.resolve())]
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # who ends this ends the server
        server = subprocess.Popen(words, env={**os.environ, "MARIMO_SKIP_UPDATE_CHECK": "1"})
        try:
            _wait(server, port)
            opened = not no_browser and webbrowser.open(address)
            click.echo(f"{'Opened' if opened else 'Open in a browser'}: {address}")
            click.echo("Ctrl-C ends it.")
            server.wait()
        finally:
            server.terminate()
            server.wait()


def _free_port(port: int | None) -> int:
    """The port, or any that is free.

    Raises a UsageError if it is taken.
    """
    with socket.socket() as trial:
        try:
            trial.bind((_HERE, port or 0))
        except OSError as error:
            raise click.UsageError(
                f"--port {port} is taken ({error.strerror}): name another, or leave it out"
            ) from error
        return int(trial.getsockname()[1])


def _wait(server: subprocess.Popen[bytes], port: int) -> None:
    """Until the server answers."""
    until = time.monotonic() + _PATIENCE
    while server.poll() is None and time.monotonic() < until:
        with socket.socket() as trial:
            if trial.connect_ex((_HERE, port)) == 0:
                return
        time.sleep(0.2)
    raise RuntimeError("the page did not start: what marimo says stands above")
