"""romsindy: equations of motion, with nonlinear inertia, from measured free decays."""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.3.0"

# Public names are listed once, in the stub that type checkers read, and imported when they are
# used: to print help needs no compiler, and to fit a model no beam.
_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_MODULE_OF = {
    alias.name: node.module
    for node in _STUB.body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
# What old names are now.
_MOVED = {
    "study": "the package romsindy_study",
    "identify_coupled": 'identify(decays, coordinates="auto"), or with a number of them',
    "identify_forced": "identify(records)",
    "free_run": "the method predict(record, samples) of what identify and refine give",
    # What functions give, and nobody makes, is imported from its room.
    "Adequacy": "romsindy.fit.adequacy.verdicts.Adequacy",
    "BackboneCurve": "romsindy.orbits.curves.BackboneCurve",
    "Band": "romsindy.fit.results.estimate.Band",
    "BeamReport": "romsindy.diagnosis.BeamReport",
    "Bifurcation": "romsindy.orbits.curves.Bifurcation",
    "Bootstrap": "romsindy.fit.refine.Bootstrap",
    "Branch": "romsindy.orbits.continuation.Branch",
    "Curve": "romsindy.fit.results.estimate.Curve",
    "DiagnosisReport": "romsindy.diagnosis.DiagnosisReport",
    "ForcedBand": "romsindy.fit.results.forced_band.ForcedBand",
    "ForcedReport": "romsindy.diagnosis.ForcedReport",
    "ForcedResponse": "romsindy.orbits.curves.ForcedResponse",
    "Inspection": "romsindy.inspection.inspection.Inspection",
    "InteractionReport": "romsindy.diagnosis.InteractionReport",
    "Reduction": "romsindy.structure.reduction.Reduction",
    "SimulatorReport": "romsindy.diagnosis.SimulatorReport",
    "SteadyFit": "romsindy.fit.steady.fit.SteadyFit",
}
_ROOMS = ("beam", "diagnosis", "effects", "physics", "show", "simulator", "structure")

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Import a public name, or a room, when it is first used (PEP 562)."""
    if name in _ROOMS:
        return import_module(f"romsindy.{name}")
    if name in _MOVED:
        raise AttributeError(f"romsindy.{name} is now {_MOVED[name]}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'romsindy' has no attribute {name!r}")
    value = getattr(import_module(str(_MODULE_OF[name])), name)
    globals()[name] = value  # the next use is a plain look-up
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})
