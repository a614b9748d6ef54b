"""``python -m romsindy``: the command, or versions for a bug report where none is given."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version

from romsindy import __version__
from romsindy.commands.main import main
from romsindy.text import aligned

_PACKAGES = ("pysindy", "numpy", "scipy", "scikit-learn", "numba", "matplotlib", "sympy")


def versions() -> str:
    """Lines of text: romsindy, Python, the packages that compute, and the system."""
    rows = [["romsindy", __version__], ["Python", platform.python_version()]]
    rows += [[name, _version(name)] for name in _PACKAGES]
    return aligned([*rows, ["platform", platform.platform()]])


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


if sys.argv[1:]:
    main()
else:
    print(versions())
