"""romsindy: equations of motion, with nonlinear inertia, from measured free decays."""

from romsindy.beam import Beam
from romsindy.diagnosis import BeamReport, DiagnosisReport, diagnose, diagnose_beam
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.bootstrap import Bootstrap, bootstrap
from romsindy.fit.refine import Band, Fit, refine
from romsindy.orbits.continuation import Branch, ContinuationError, Steps, continue_branch
from romsindy.orbits.curves import (
    BackboneCurve,
    Bifurcation,
    ForcedResponse,
    backbone_curve,
    forced_response,
)
from romsindy.physics.example import add_noise, example_decay
from romsindy.physics.model import ReducedModel, SingularInertiaError
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay, save_decay
from romsindy.record.filters import Butterworth, SavitzkyGolay
from romsindy.regression.estimator import HarmonicSINDy, ScaledOptimizer
from romsindy.regression.library import (
    BeamTheoryLibrary,
    DampingLibrary,
    ICROMLibrary,
    ROMLibrary,
    StiffnessLibrary,
    implicit_data,
)
from romsindy.regression.projection import HarmonicLibrary, HarmonicProjection
from romsindy.selection.select import Selection, default_candidates, select_model

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
