"""The page of ``romsindy app``: drop a record, look, identify, compare, take the results along."""

import marimo

app = marimo.App(width="medium", app_title="romsindy")


@app.cell
def _():
    from html import escape
    from pathlib import Path

    import marimo as mo

    from romsindy_app.picking import draw, picked
    from romsindy_app.session import SIMULATIONS, Choice, Session

    session = Session()
    get_job, set_job = mo.state(None)

    def words(text, kind="neutral"):
        """What a command says, as it says it."""
        look = "white-space: pre-wrap; overflow-wrap: anywhere; font-size: .8rem; margin: 0"
        return mo.callout(mo.Html(f'<pre style="{look}">{escape(text)}</pre>'), kind=kind)

    return Choice, Path, SIMULATIONS, draw, get_job, mo, picked, session, set_job, words


@app.cell
def _(mo):
    mo.md(
        """
        # From a vibration that rings down to its equation of motion

        Drop a record (CSV, MATLAB, LVM, WAV, NPZ, ...), choose what is meant, identify. It stays on
        this machine.
        """
    )
    return


@app.cell
def _(mo):
    drop = mo.ui.file(kind="area", label="Drop a record here, or click")
    drop
    return (drop,)


@app.cell
def _(Path, drop, mo, session):
    _named = mo.cli_args().get("file")
    record = None
    if drop.value:
        record = session.put(drop.name(), drop.contents())
    elif _named:
        record = session.put(Path(_named).name, Path(_named).read_bytes())
    mo.stop(record is None)
    return (record,)


@app.cell
def _(mo, record):
    unit = mo.ui.text(label="Unit, where the file does not say it", placeholder="mm, m/s, g, deg")
    mo.accordion({f"Reading of {record.name}": unit})
    return (unit,)


@app.cell
def _(mo, record, session, unit):
    _names = session.channels(record, unit.value.strip())
    columns = mo.ui.multiselect(_names, label="Channels, where not all are meant")
    columns if len(_names) > 1 else None
    return (columns,)


@app.cell
def _(Choice, columns, mo, record, session, unit):
    reading = Choice(tuple(columns.value), unit.value.strip())
    with mo.status.spinner(title=f"Looking at {record.name}"):
        seen, said, look = session.inspect(record, reading)
    return look, reading, said, seen


@app.cell
def _(look, mo, said, seen, words):
    _parts = [words(said, "danger" if seen is None else "neutral")]
    if look is not None:
        _page = mo.iframe(look.read_text(encoding="utf-8"), height="60rem")
        _parts.append(mo.accordion({"Pictures and tables": _page}, lazy=True))
    mo.vstack(_parts)
    return


@app.cell
def _(draw, mo, seen):
    mo.stop(seen is None or not seen["modes"])
    box = mo.ui.matplotlib(draw(seen), debounce=True)
    _how = "Draw a box around the dots of the vibration that is meant, or choose it below."
    mo.vstack([mo.md(_how), box])
    return (box,)


@app.cell
def _(box, mo, picked, seen):
    _mode, _release = picked(seen, box.value.get_mask) if box.value else (None, None)
    _modes = {"the one that moves most": None}
    for _m in seen["modes"]:
        _ends = " to ".join(f"{_m['frequency'][end]:.5g}" for end in ("loud", "quiet"))
        _modes[f"{_m['number']}: {_ends} Hz"] = _m["number"]
    _releases = {"all": None}
    for _i, _r in enumerate(seen["releases"], 1):
        _releases[f"{_i}: {_r['start']:.4g} to {_r['end']:.4g} s"] = _i
    _names = [{number: name for name, number in x.items()} for x in (_modes, _releases)]
    mode = mo.ui.dropdown(_modes, value=_names[0][_mode], label="Mode")
    release = mo.ui.dropdown(_releases, value=_names[1][_release], label="Release")
    identify = mo.ui.run_button(label="Identify", kind="success")
    mo.hstack([mode, release, identify], justify="start", align="end", wrap=True)
    return identify, mode, release


@app.cell
def _(Choice, mode, reading, release):
    choice = Choice(reading.columns, reading.unit, mode.value, release.value)
    return (choice,)


@app.cell
def _(choice, identify, mo, record, session, set_job):
    mo.stop(not identify.value)
    set_job(session.identify(record, choice))
    return


@app.cell
def _(SIMULATIONS, identify, mo):
    identify  # what compares comes below what identifies
    _first, *_ = SIMULATIONS
    kind = mo.ui.dropdown(list(SIMULATIONS), value=_first, label="The simulation is")
    simulation = mo.ui.file(kind="button", label="Choose its file")
    compare = mo.ui.run_button(label="Compare", kind="success")
    _row = mo.hstack([kind, simulation, compare], justify="start", align="end", wrap=True)
    mo.accordion({"Compare it with a simulation: what does that lack?": _row})
    return compare, kind, simulation


@app.cell
def _(SIMULATIONS, choice, compare, kind, mo, record, session, set_job, simulation, words):
    mo.stop(not compare.value)
    mo.stop(not simulation.value, words("Choose the file of the simulation first.", "warn"))
    _file = session.put(simulation.name(), simulation.contents())
    set_job(session.diagnose(record, choice, SIMULATIONS[kind.value], _file))
    return


@app.cell
def _(get_job, mo):
    mo.stop(get_job() is None)
    _running = get_job().running
    tick = mo.ui.refresh(default_interval="1s") if _running else None
    stop = mo.ui.button(label="Stop", kind="danger", on_click=lambda _: get_job().stop())
    return stop, tick


@app.cell
def _(get_job, mo, set_job, stop, tick):
    mo.stop(get_job() is None or get_job().said is not None)
    tick  # asked again each second
    if not get_job().running:
        set_job(get_job())  # what shows results looks again
    _words = mo.md(f"`romsindy {get_job().words[0]}` runs, {get_job().seconds:.0f} s")
    mo.hstack([_words, stop, tick], justify="start", align="center")
    return


@app.cell
def _(choice, get_job, mo, record, session, words):
    mo.stop(get_job() is None or get_job().running)
    _job = get_job()
    _files = _job.files()
    _texts = {
        "commands.txt": "\n".join(session.commands) + "\n",
        "script.py": session.script(record, choice),
    }
    _kind = "danger" if _job.refused and not _files else "warn" if _job.stopped else "neutral"
    _links = [
        mo.download(path.read_bytes(), filename=path.name, label=f"Download {what}")
        for what, path in _files.items()
    ]
    _links += [mo.download(text, filename=name, label=name) for name, text in _texts.items()]
    _parts = [words(_job.said, _kind), mo.hstack(_links, justify="start", wrap=True)]
    _parts.append(mo.accordion({name: mo.plain_text(text) for name, text in _texts.items()}))
    if "page" in _files:
        _parts.append(mo.iframe(_files["page"].read_text(encoding="utf-8"), height="80rem"))
    mo.vstack(_parts)
    return


if __name__ == "__main__":
    app.run()
