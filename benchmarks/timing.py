"""How long something takes."""

from __future__ import annotations

import time
from collections.abc import Callable


def fastest(action: Callable[[], object], repeats: int = 5) -> float:
    """Shortest of several runs, s: the machine may be doing something else too."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)
