"""Find what a simulation lacks: name it, add it, show the gap shrink."""

from romsindy.diagnosis.catalogue import CATALOGUE
from romsindy.diagnosis.effects import Effect, ReadingEffect, Shape, TermEffect, TimedEffect
from romsindy.diagnosis.report import DiagnosisReport, FoundEffect
from romsindy.diagnosis.structure import BeamReport, diagnose_beam
from romsindy.diagnosis.workflow import diagnose

__all__ = [
    "CATALOGUE",
    "BeamReport",
    "DiagnosisReport",
    "Effect",
    "FoundEffect",
    "ReadingEffect",
    "Shape",
    "TermEffect",
    "TimedEffect",
    "diagnose",
    "diagnose_beam",
]
