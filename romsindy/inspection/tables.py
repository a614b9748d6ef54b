"""An inspection in words: tables, and the commands that come next."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Iterator, Sequence

import numpy as np

from romsindy.inspection.findings import Findings, Mode
from romsindy.record.forced import input_names
from romsindy.text import TextTable, aligned, as_options, listed, quantity, span

# Rows that are printed where not all are asked for.
_SHORT_RELEASES, _SHORT_MODES, _SHORT_WRONG, _SHORT_STEPS = 2, 3, 2, 3
_MOST_STEPS = 5  # of a kind that are offered
_MOST_TOGETHER = 4  # channels of a command
_MOST_LEFT = 4  # modes that are named, loudest first


def report(found: Findings, command: str = "") -> str:
    """All tables, what would be used, and what comes next, as plain text.

    Remedies are options where ``command`` is a command line, and arguments of Python without.
    """
    blocks = []
    for table in tables(found):
        note = f"  {table.note}\n" if table.note else ""
        blocks.append(f"{table.title}\n{aligned(table.rows, '  ')}\n{note}")
    steps = "\n".join(f"  {step}" for step in next_steps(found, command))
    text = "\n".join([*blocks, summary(found), *(["Next:", steps] if steps else [])])
    return as_options(text) if command else text


def short(found: Findings, command: str = "") -> str:
    """What was found, how sure, what is wrong with it and what comes next, in 19 lines at most."""
    about, noise = _about(found)
    lines, parts = [about, noise], {t.title.split(",")[0]: t for t in tables(found)}
    if "Releases" in parts:
        lines += _first(parts["Releases"].rows, _SHORT_RELEASES)
    if "Modes" in parts:
        table = parts["Modes"]
        # That which is used comes first: a loud acceleration may be a small motion.
        used = [m for m in found.modes if not m.steady and m is found.dominant]
        rest = sorted((m for m in found.modes if m not in used), key=lambda m: -m.share)
        shown = [*used, *rest][:_SHORT_MODES]
        rows = [
            table.rows[0],
            *(table.rows[m.number] for m in sorted(shown, key=lambda m: m.number)),
        ]
        lines += [table.title, *_first(rows, _SHORT_MODES)]
        lines += [f"  {words}" for words in _near(found, shown)[:1]]
    wrong = found.warnings
    lines += [f"Wrong: {words}." for words in wrong[:_SHORT_WRONG]]
    hidden = {
        "release": len(found.releases) - _SHORT_RELEASES,
        "mode": len(found.modes) - _SHORT_MODES,
        "defect": len(wrong) - _SHORT_WRONG,
    }
    more = [f"{n} {name}{'s' * (n > 1)}" for name, n in hidden.items() if n > 0]
    lines += [f"Not shown: {listed(more)} (--full shows them)."] if more else []
    steps = itertools.islice(next_steps(found, command), _SHORT_STEPS)
    lines += [summary(found), "Next:", *(f"  {step}" for step in steps)]
    text = "\n".join(lines if lines[-1] != "Next:" else lines[:-1])
    return as_options(text) if command else text


def _first(rows: Sequence[Sequence[str]], count: int) -> list[str]:
    """The header and the first rows of a table, a line each."""
    return aligned(rows[: count + 1], "  ").splitlines()


def _about(found: Findings) -> tuple[str, str]:
    """What the record is, and how sure its numbers are."""
    (_, source), (_, samples), (_, what) = itertools.islice(_record(found), 3)
    about = f"{source}: {samples.replace(' at', ' samples at', 1)}, {what}"
    if found.recording.drives:
        about += f"; {listed([str(drive) for drive in found.recording.drives])}"
    own = next(n for n in found.noise if n.channel == found.channel)
    if not np.isfinite(own.rms):
        return about, f"Noise in channel {own.channel}: not known."
    level = quantity(own.rms, found.recording.signal_unit)
    return about, f"Noise {level} rms in channel {own.channel}, signal {own.ratio:.1f} dB over it."


def tables(found: Findings) -> list[TextTable]:
    """What is in the record: those tables that are not empty."""
    steady = "steady: mains or a motor, no mode"
    channels = ["channel", "noise (rms)", "signal over noise [dB]", ""]
    releases = ["release", "from [s]", "to [s]", "cycles", "largest", "begins", "ends"]
    modes = ["mode", "frequency [Hz]", "damping ratio [%]", "amplitude", "of the energy [%]"]
    left_out = [[f"{p.start:.6g}", f"{p.end:.6g}", p.reason] for p in found.discarded]
    all_of_them = [
        TextTable("Record", list(_record(found))),
        TextTable("Channels", [channels, *_channels(found)]),
        TextTable("Releases", [releases, *_releases(found)]),
        TextTable("Left out", [["from [s]", "to [s]", "why"], *left_out]),
        TextTable("Defects", [["what"], *([w] for w in found.warnings)]),
        TextTable(
            f"Modes, from loud to quiet, in channel {found.channel}",
            [[*modes, "harmonics", ""], *(_mode(found, m, steady) for m in found.modes)],
            " ".join(_near(found, found.modes)),
        ),
    ]
    return [table for table in all_of_them if len(table.rows) > 1]


def _near(found: Findings, shown: Sequence[Mode]) -> list[str]:
    """Which of some modes come near a ratio of small whole numbers, a sentence each."""
    return [
        f"Mode {high.number} is {r.ratio:.4g} times mode {low.number} at an amplitude of"
        f" {quantity(r.amplitude, _unit(found))}: near {r.p}:{r.q}."
        for low, high, r in found.resonances
        if low in shown and high in shown
    ]


def summary(found: Findings) -> str:
    """What `identify` would use of the record, and what not, in one or two sentences."""
    try:
        mode = found.mode()
    except ValueError as error:
        return f"Nothing can be identified: {error}."
    return picked(found, mode, found.rings_in(mode))


def picked(found: Findings, mode: Mode, releases: Sequence[int]) -> str:
    """Which mode and releases (from 0) are used, and which are left out."""
    names = [str(i + 1) for i in releases]
    used = f"Used: mode {mode.number} at {mode.hertz} Hz"
    if mode is found.mode() and sum(not m.steady for m in found.modes) > 1:
        used += ", which moves most,"
    inside = found.in_phase(mode)
    channels = f"channel{'s' * (len(inside) > 1)} {listed(inside)}"
    used += f" in {channels}, release{'s' * (len(names) > 1)} {listed(names)}."
    left = [m for m in found.modes if m is not mode]
    left = sorted(left, key=lambda m: -m.share)
    rest = [str(i + 1) for i in range(len(found.releases)) if i not in releases]
    kinds = {False: "mode", True: "steady tone"}
    out = [f"{kinds[m.steady]} {m.number} at {m.hertz} Hz" for m in left[:_MOST_LEFT]]
    out += [f"{len(left) - _MOST_LEFT} more"] if len(left) > _MOST_LEFT else []
    out += [f"release {listed(rest)}"] if rest else []
    out += [f"channel {name}" for name in found.recording.names if name not in inside]
    used = f"{used} Left out: {', '.join(out)}." if out else used
    r = found.recording
    guessed = r.basis.startswith(("name", "assumed"))  # no unit and no code says it
    return f"{used} Taken as {r.quantity}: {r.basis}." if guessed else used


def picked_together(found: Findings, releases: Sequence[int]) -> str:
    """Which releases (from 0) are used with all that rings in them, and which are left out."""
    names = [str(i + 1) for i in releases]
    channels = f"channel{'s' * (len(found.together) > 1)} {listed(found.together)}"
    rings = listed([f"{m.hertz} Hz" for m in found.modes if not m.steady])
    release = f"release{'s' * (len(names) > 1)} {listed(names)}"
    where = f" in channel {found.channel}" if len(found.together) > 1 else ""
    used = f"Used: {channels}, {release}, with all that rings: {rings}{where}."
    if (lever := found.recording.lever) is not None:
        used += f" Angles are lengths at a lever arm of {lever:g} m."
    rest = [str(i + 1) for i in range(len(found.releases)) if i not in releases]
    return f"{used} Left out: release {listed(rest)}." if rest else used


def next_steps(found: Findings, command: str = "") -> Iterator[str]:
    """What to do next, with the choices that the record offers.

    As command lines where ``command`` is one that identifies the record, as calls in Python
    without.
    """
    ringing = [m for m in found.modes if not m.steady]
    drives, response = found.recording.drives, found.channel * (len(found.recording.names) > 1)
    if found.recording.driven:
        kinds = [drive.kind for drive in drives if drive.lasting]
        yield _driven_step(found, command, kinds, response)
    elif kinds := [drive.kind for drive in drives if drive.acts]:  # a blow tells the mass as well
        yield _driven_step(found, command, kinds, response)
    for response, column in found.may_drive[:_MOST_STEPS]:
        yield _driven_step(found, command, ["force"], response, column)
    if not ringing:
        return
    main, channels = found.dominant, found.recording.names
    others = sorted((m for m in ringing if m is not main), key=lambda m: -m.share)
    choices: list[tuple[str, object]] = [("mode", m.number) for m in others]
    if len(found.rings_in(main)) > 1:
        choices.append(("release", found.rings_in(main)[0] + 1))
    if command:

        def of(inside: Sequence[str]) -> str:
            used = inside if len(inside) <= _MOST_TOGETHER else (found.channel,)
            names = "".join(f" --column {shlex.quote(name)}" for name in used)
            return command + names if channels[1:] else command

        alike = of(found.in_phase(main))
        start = {"mode": of(found.together), "release": alike}
        yield alike
        yield from (f"{start[name]} --{name} {value}" for name, value in choices[:_MOST_STEPS])
        alone = [of((n.channel,)) for n in found.noise if n.rings and channels[1:]]
        yield from [line for line in alone if line != alike][:_MOST_STEPS]
    else:
        yield "rs.identify(seen.decays())"
        calls = (f"rs.identify(seen.decays({n}={v}))" for n, v in choices[:_MOST_STEPS])
        yield from calls


def _driven_step(
    found: Findings, command: str, kinds: Sequence[str], response: str, column: str = ""
) -> str:
    """How a record that is driven is identified with its inputs, or with a ``column`` as that."""
    response = "" if " --column " in command else response  # it is chosen
    named = {"column": response, "input_column": column}
    given = {name: value for name, value in named.items() if value}
    if command:
        options = {name.replace("_", "-"): shlex.quote(value) for name, value in given.items()}
        inputs = [("input", kind) for kind in kinds]
        told = "".join(f" --{name} {value}" for name, value in (*options.items(), *inputs))
        return f"{command}{told} --select"
    more = "".join(f", {name}={value!r}" for name, value in given.items())
    return f"rs.identify(rs.load_forced({found.recording.source!r}, {input_names(kinds)}{more}))"


# -- rows ---------------------------------------------------------------------------------------


def _record(found: Findings) -> Iterator[list[str]]:
    r = found.recording
    yield ["file", r.source or "(none)"]
    yield ["samples", f"{len(r.t)} at {1 / r.dt:.6g} Hz, from {r.t[0]:.6g} to {r.t[-1]:.6g} s"]
    basis = f" ({r.basis})" if r.basis else ""
    unit = r.signal_unit if r.unit else "a unit that is not known: give it by unit="
    yield ["quantity", f"{r.quantity} in {unit}{basis}"]
    for drive in r.drives:
        yield ["input", str(drive)]
    for note in r.notes:
        yield ["note", note]


def _channels(found: Findings) -> Iterator[list[str]]:
    for noise in found.noise:
        looked_at = noise.channel == found.channel and len(found.noise) > 1
        level = quantity(noise.rms, found.recording.signal_unit)
        known = np.isfinite(noise.rms)
        ratio = f"{noise.ratio:.1f}" if known else "-"
        words = "modes are looked for here" if looked_at else "" if noise.rings else "noise alone"
        yield [noise.channel, level if known else "-", ratio, words]


def _releases(found: Findings) -> Iterator[list[str]]:
    for i, r in enumerate(found.releases, 1):
        peak = quantity(r.peak, found.recording.signal_unit)
        times = [f"{r.start:.6g}", f"{r.end:.6g}"]
        yield [str(i), *times, f"{r.cycles:.0f}", peak, r.why_start, r.why_end]


def _mode(found: Findings, mode: Mode, steady: str) -> list[str]:
    loud, quiet = mode.damping_ratio
    words = [steady] if mode.steady else []
    rings = [str(i + 1) for i in found.rings_in(mode)]
    if len(rings) < len(found.releases):
        words.append(f"in release {listed(rings)} alone")
    return [
        str(mode.number),
        mode.hertz,
        "-" if mode.steady else span(100 * loud, 100 * quiet, 2),
        " to ".join(dict.fromkeys(quantity(a, _unit(found)) for a in mode.amplitude)),
        f"{100 * mode.share:.3g}",
        ", ".join(map(str, mode.harmonics)) or "-",
        "; ".join(words),
    ]


def _unit(found: Findings) -> str:
    return found.recording.unit or "[q]"
