"""What a beam lacks: the diagnosis on a finite-element beam that is seen through sensors."""

from romsindy.diagnosis.structure.beam_file import load_beam
from romsindy.diagnosis.structure.forces import (
    FrictionForce,
    SquaredForce,
    StoredForce,
    ViscousForce,
)
from romsindy.diagnosis.structure.instrumented import InstrumentedBeam
from romsindy.diagnosis.structure.report import BeamReport
from romsindy.diagnosis.structure.workflow import diagnose_beam

__all__ = [
    "BeamReport",
    "FrictionForce",
    "InstrumentedBeam",
    "SquaredForce",
    "StoredForce",
    "ViscousForce",
    "diagnose_beam",
    "load_beam",
]
