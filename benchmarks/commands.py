"""Processor time of what a user waits for: imports, help, a first fit, the quick study.

    python benchmarks/commands.py [--study]

Every line is a process of its own; the number is user plus system time, the median of five runs
(one of the study).
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile

_FIT = "import romsindy as rs; rs.HarmonicSINDy().fit(rs.example_decay())"
_PROCESSES = {
    "import pysindy": ["-c", "import pysindy"],
    "import romsindy": ["-c", "import romsindy"],
    "import romsindy, one fit of the example": ["-c", _FIT],
    "romsindy --help": ["-m", "romsindy", "--help"],
    "romsindy identify --help": ["-m", "romsindy", "identify", "--help"],
}


def processor_time(arguments: list[str]) -> float:
    """User plus system time of one process and its children, s."""
    before = os.times()
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True, cwd=folder)
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])


def main() -> None:
    for name, arguments in _PROCESSES.items():
        seconds = statistics.median(processor_time(arguments) for _ in range(5))
        print(f"{name:<45} {seconds:6.2f} s")
    if "--study" in sys.argv:
        seconds = processor_time(["-m", "romsindy", "study", "--quick"])
        print(f"{'romsindy study --quick':<45} {seconds:6.1f} s")


if __name__ == "__main__":
    main()
