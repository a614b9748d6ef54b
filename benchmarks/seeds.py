"""What trials that go by seeds share: their command line, processes, and a step in time."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from typing import Any

from joblib import Parallel, delayed


def parser_of(text: str, count: int, what: str = "records", first: int = 0) -> Any:
    """A command line with the first seed, how many there are, and the number of processes."""
    parser = argparse.ArgumentParser(description=text.split("\n")[0])
    parser.add_argument("--first", type=int, default=first, help="first seed")
    parser.add_argument("--count", type=int, default=count, help=what)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    return parser


def tried(given: Any, trial: Callable[..., Any], *more: Any) -> Iterator[Any]:
    """What ``trial(seed, *more)`` gives of each seed, in their order, as soon as it is there."""
    seeds = range(given.first, given.first + given.count)
    tasks = (delayed(trial)(seed, *more) for seed in seeds)
    yield from Parallel(given.jobs, return_as="generator")(tasks)


def step(rate, h, q, v, first, middle, last):
    """One step of Runge and Kutta's method for q'' = rate(force, q, q')."""
    a1 = rate(first, q, v)
    a2 = rate(middle, q + h / 2 * v, v + h / 2 * a1)
    a3 = rate(middle, q + h / 2 * (v + h / 2 * a1), v + h / 2 * a2)
    a4 = rate(last, q + h * (v + h / 2 * a2), v + h * a3)
    return q + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
