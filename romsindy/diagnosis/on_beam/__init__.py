"""What a beam lacks: the diagnosis on a finite-element beam that is seen through sensors."""

from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.report import BeamReport
from romsindy.diagnosis.on_beam.workflow import diagnose_beam
