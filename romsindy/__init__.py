"""romsindy: equations of motion, with nonlinear inertia, from measured free decays."""

from romsindy.adequacy import Adequacy
from romsindy.backbone import Backbone, extract_backbone
from romsindy.beam import Beam
from romsindy.bootstrap import Bootstrap, bootstrap
from romsindy.continuation import Branch, ContinuationError, Steps, continue_branch
from romsindy.decay import Decay
from romsindy.diagnosis import BeamReport, DiagnosisReport, diagnose, diagnose_beam
from romsindy.files import load_decay, save_decay
from romsindy.filters import Butterworth, SavitzkyGolay
from romsindy.harmonic import HarmonicLibrary, HarmonicProjection
from romsindy.library import (
    BeamTheoryLibrary,
    DampingLibrary,
    ICROMLibrary,
    ROMLibrary,
    StiffnessLibrary,
    implicit_data,
)
from romsindy.model import ReducedModel, SingularInertiaError
from romsindy.orbits import (
    BackboneCurve,
    Bifurcation,
    ForcedResponse,
    backbone_curve,
    forced_response,
)
from romsindy.refine import Band, Fit, refine
from romsindy.regression import HarmonicSINDy, ScaledOptimizer
from romsindy.selection import Selection, default_candidates, select_model
from romsindy.synthetic import add_noise, example_decay

__version__ = "0.1.0"

__all__ = [
    "Adequacy",
    "Backbone",
    "BackboneCurve",
    "Band",
    "Beam",
    "BeamReport",
    "BeamTheoryLibrary",
    "Bifurcation",
    "Bootstrap",
    "Branch",
    "Butterworth",
    "ContinuationError",
    "DampingLibrary",
    "Decay",
    "DiagnosisReport",
    "Fit",
    "ForcedResponse",
    "HarmonicLibrary",
    "HarmonicProjection",
    "HarmonicSINDy",
    "ICROMLibrary",
    "ROMLibrary",
    "ReducedModel",
    "SavitzkyGolay",
    "ScaledOptimizer",
    "Selection",
    "SingularInertiaError",
    "Steps",
    "StiffnessLibrary",
    "add_noise",
    "backbone_curve",
    "bootstrap",
    "continue_branch",
    "default_candidates",
    "diagnose",
    "diagnose_beam",
    "example_decay",
    "extract_backbone",
    "forced_response",
    "implicit_data",
    "load_decay",
    "refine",
    "save_decay",
    "select_model",
]
