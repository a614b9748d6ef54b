# The public names and where they live; `__init__.py` reads this list.

from romsindy.beam import BaseAcceleration as BaseAcceleration
from romsindy.beam import Beam as Beam
from romsindy.beam import PointForce as PointForce
from romsindy.diagnosis import diagnose as diagnose
from romsindy.fit.functions.identification import Identification as Identification
from romsindy.fit.identify import identify as identify
from romsindy.fit.refine import bootstrap as bootstrap
from romsindy.fit.refine import refine as refine
from romsindy.fit.results.estimate import Estimate as Estimate
from romsindy.fit.results.fitted import Fit as Fit
from romsindy.fit.steady.fit import fit_steady as fit_steady
from romsindy.inspection.inspection import inspect as inspect
from romsindy.orbits.continuation import ContinuationError as ContinuationError
from romsindy.orbits.continuation import Steps as Steps
from romsindy.orbits.continuation import continue_branch as continue_branch
from romsindy.orbits.curves import backbone_curve as backbone_curve
from romsindy.orbits.curves import forced_response as forced_response
from romsindy.physics.coupled import CoupledModel as CoupledModel
from romsindy.physics.equations import SingularInertiaError as SingularInertiaError
from romsindy.physics.example import add_noise as add_noise
from romsindy.physics.example import example_decay as example_decay
from romsindy.physics.integration import EscapeError as EscapeError
from romsindy.physics.model import ReducedModel as ReducedModel
from romsindy.record.backbone import Backbone as Backbone
from romsindy.record.backbone import extract_backbone as extract_backbone
from romsindy.record.decay import Decay as Decay
from romsindy.record.files import load_decay as load_decay
from romsindy.record.files import load_forced as load_forced
from romsindy.record.files import load_recording as load_recording
from romsindy.record.files import save_decay as save_decay
from romsindy.record.forced import ForcedVibration as ForcedVibration
from romsindy.record.recording import Recording as Recording
from romsindy.record.smoothing import Butterworth as Butterworth
from romsindy.record.smoothing import SavitzkyGolay as SavitzkyGolay
from romsindy.regression.estimator import HarmonicSINDy as HarmonicSINDy
from romsindy.regression.estimator import ScaledOptimizer as ScaledOptimizer
from romsindy.regression.library import BeamTheoryLibrary as BeamTheoryLibrary
from romsindy.regression.library import DampingLibrary as DampingLibrary
from romsindy.regression.library import ICROMLibrary as ICROMLibrary
from romsindy.regression.library import ROMLibrary as ROMLibrary
from romsindy.regression.library import StiffnessLibrary as StiffnessLibrary
from romsindy.regression.library import implicit_data as implicit_data
from romsindy.regression.projection import HarmonicLibrary as HarmonicLibrary
from romsindy.regression.projection import HarmonicProjection as HarmonicProjection
from romsindy.regression.windows import WindowProjection as WindowProjection
from romsindy.structure import Structure as Structure

__version__: str
__all__: list[str]
