"""Every kind and dress of file against one reference, and damaged files of all of them.

    python benchmarks/files.py [--count 2000] [--seed 0]

First a good file of every dress is read and compared with the reference. Then good files are
damaged: bytes changed, deleted, inserted; lines lost, doubled, swapped; separators and signs
exchanged; ends cut off; names changed. Each must be read as it was or refused in a sentence, by a
process that is watched for crashes, hangs and tracebacks. What is read otherwise is listed by dress
and kind of damage: a number that differs because a digit does cannot be told from a measured one.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
from file_dresses import DRESSES, T, X

from romsindy import load_recording

_LIMIT = 30.0  # s for one file
Damage = tuple[str, bytes]


def difference(path: Path, settings: dict[str, Any], tolerance: float) -> str:
    """How a file is read: "equal", "refused", or what differs from the reference."""
    arguments = {name: value for name, value in settings.items() if name != "scale"}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            recording = load_recording(path, **arguments)
    except (ValueError, OSError) as error:
        return "refused" if str(error).startswith(str(path)) else f"refused without a name: {error}"
    except Exception as error:
        return f"TRACEBACK {type(error).__name__}: {error}"
    if recording.quantity != "acceleration" or recording.unit != "m":
        return f"read as {recording.quantity} in {recording.signal_unit}"
    if recording.x.shape != (len(T), 1):
        x = recording.x.ravel() * settings.get("scale", 1.0)
        known = np.abs(x[:, None] - X).min(axis=1) <= tolerance * np.abs(X).max()
        return "samples missing or doubled" if known.all() else "other length, samples differ"
    # The resolution of stamps of a day is 1e-11 s, LVM's grid is summed.
    if not np.allclose(recording.t - recording.t[0], T, rtol=0, atol=1e-9):
        return "other times"
    error = np.abs(recording.x[:, 0] * settings.get("scale", 1.0) - X)
    bad = np.count_nonzero(~(error <= tolerance * np.abs(X).max()))
    return "equal" if bad == 0 else "one sample differs" if bad == 1 else "samples differ"


def damaged(content: bytes, rng: np.random.Generator) -> Damage:
    """One kind of damage, drawn at random, done to the bytes of a file."""
    kinds = [_changed, _cut_out, _inserted, _cut_off, _zeroed]
    if _is_text(content):
        kinds += [
            _line_lost,
            _line_doubled,
            _lines_swapped,
            _signs_exchanged,
            _signs_exchanged_once,
        ]
    kind = kinds[rng.integers(len(kinds))]
    return kind.__name__.strip("_").replace("_", " "), kind(content, rng)


def _is_text(content: bytes) -> bool:
    return content.count(b"\n") > 100 and b"\0" not in content[:1000]


def _changed(content: bytes, rng: np.random.Generator) -> bytes:
    found = bytearray(content)
    for i in rng.integers(len(found), size=rng.integers(1, 6)):
        found[i] = rng.integers(256)
    return bytes(found)


def _cut_out(content: bytes, rng: np.random.Generator) -> bytes:
    a = int(rng.integers(len(content)))
    return content[:a] + content[a + int(rng.integers(1, 50)) :]


def _inserted(content: bytes, rng: np.random.Generator) -> bytes:
    a = int(rng.integers(len(content)))
    return content[:a] + rng.bytes(int(rng.integers(1, 50))) + content[a:]


def _cut_off(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _zeroed(content: bytes, rng: np.random.Generator) -> bytes:
    a, n = int(rng.integers(len(content))), int(rng.integers(1, 600))
    return content[:a] + bytes(min(n, len(content) - a)) + content[a + n :]


def _line_lost(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    del lines[rng.integers(len(lines))]
    return b"".join(lines)


def _line_doubled(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    i = int(rng.integers(len(lines)))
    return b"".join([*lines[:i], lines[i], *lines[i:]])


def _lines_swapped(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    i, k = rng.integers(len(lines), size=2)
    lines[i], lines[k] = lines[k], lines[i]
    return b"".join(lines)


def _signs_exchanged(content: bytes, rng: np.random.Generator) -> bytes:
    old, new = rng.choice(list(",;\t ."), size=2, replace=False)
    return content.replace(old.encode(), new.encode())


def _signs_exchanged_once(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    i = int(rng.integers(len(lines)))
    lines[i] = _signs_exchanged(lines[i], rng)
    return b"".join(lines)


def good(folder: Path) -> dict[str, str]:
    """How a good file of every dress is read."""
    found = {}
    for name, (write, settings, tolerance) in DRESSES.items():
        write(folder / name)
        found[name] = difference(folder / name, settings, tolerance)
    return found


def bad(folder: Path, count: int, seed: int) -> Counter[tuple[str, str, str]]:
    """How damaged files are read: counts by result, dress and damage."""
    rng = np.random.default_rng(seed)
    names = list(DRESSES)
    contents = {}
    for name in names:
        DRESSES[name][0](folder / name)
        contents[name] = (folder / name).read_bytes()
    found: Counter[tuple[str, str, str]] = Counter()
    pool = ProcessPoolExecutor(1)
    for i in range(count):
        name = names[i % len(names)]
        kind, content = damaged(contents[name], rng)
        suffix = Path(name).suffix
        if rng.random() < 0.05:
            kind, content = "renamed", contents[name]
            suffix = Path(names[rng.integers(len(names))]).suffix
        path = folder / f"damaged_{i}{suffix}"
        path.write_bytes(content)
        try:
            result = pool.submit(difference, path, *DRESSES[name][1:]).result(timeout=_LIMIT)
        except (BrokenProcessPool, TimeoutError) as error:
            result = "CRASH" if isinstance(error, BrokenProcessPool) else "HANG"
            _stop(pool)
            pool = ProcessPoolExecutor(1)
        found[result, name, kind] += 1
        if result in ("equal", "refused"):
            path.unlink()
    pool.shutdown()
    return found


def _stop(pool: ProcessPoolExecutor) -> None:
    for process in list((pool._processes or {}).values()):
        process.kill()
    pool.shutdown(wait=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the files that are read otherwise")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(exist_ok=True)
        found = good(folder)
        equal = sum(result == "equal" for result in found.values())
        print(f"good files: {equal} of {len(found)} dresses equal to the reference")
        print(*(f"  {name}: {r}" for name, r in found.items() if r != "equal"), sep="\n", end="")
        damage = bad(folder, arguments.count, arguments.seed)
    totals: Counter[str] = Counter()
    for (result, *_), n in damage.items():
        totals[result] += n
    print(f"{arguments.count} damaged files:")
    for result, n in totals.most_common():
        print(f"{n:6d} {result}")
    print("read otherwise, by dress and damage:")
    for (result, name, kind), n in sorted(damage.items()):
        if result not in ("equal", "refused"):
            print(f"{n:6d} {result:24} {name:22} {kind}")


if __name__ == "__main__":
    main()
