"""romsindy: equations of motion, with nonlinear inertia, from measured free decays."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# Public names by the module that they live in. A module is imported when a name of it is used:
# to print help needs no compiler, and to fit a model no beam. `__init__.pyi` says the same to type
# checkers.
_HOMES = {
    "romsindy.beam": ("Beam",),
    "romsindy.diagnosis": ("BeamReport", "DiagnosisReport", "diagnose"),
    "romsindy.fit.adequacy": ("Adequacy",),
    "romsindy.fit.bootstrap": ("Bootstrap", "bootstrap"),
    "romsindy.fit.refine": ("Band", "Fit", "refine"),
    "romsindy.orbits.continuation": ("Branch", "ContinuationError", "Steps", "continue_branch"),
    "romsindy.orbits.curves": (
        "BackboneCurve",
        "Bifurcation",
        "ForcedResponse",
        "backbone_curve",
        "forced_response",
    ),
    "romsindy.physics.example": ("add_noise", "example_decay"),
    "romsindy.physics.model": ("ReducedModel", "SingularInertiaError"),
    "romsindy.record.backbone": ("Backbone", "extract_backbone"),
    "romsindy.record.decay": ("Decay",),
    "romsindy.record.files": ("load_decay", "save_decay"),
    "romsindy.record.filters": ("Butterworth", "SavitzkyGolay"),
    "romsindy.regression.estimator": ("HarmonicSINDy", "ScaledOptimizer"),
    "romsindy.regression.library": (
        "BeamTheoryLibrary",
        "DampingLibrary",
        "ICROMLibrary",
        "ROMLibrary",
        "StiffnessLibrary",
        "implicit_data",
    ),
    "romsindy.regression.projection": ("HarmonicLibrary", "HarmonicProjection"),
    "romsindy.selection.select": ("Selection", "default_candidates", "select_model"),
}
_ROOMS = ("beam", "diagnosis", "effects", "physics", "show", "study")
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Import a public name, or a room, when it is first used (PEP 562)."""
    if name in _ROOMS:
        return import_module(f"romsindy.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'romsindy' has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value  # the next use is a plain look-up
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})
