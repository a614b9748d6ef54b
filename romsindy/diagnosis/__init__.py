"""Find what a simulation lacks: name it, add it, show the gap shrink."""

from romsindy.diagnosis.diagnose import diagnose
from romsindy.diagnosis.found import FoundEffect
from romsindy.diagnosis.next_test import EXPERIMENTS, Advice, Experiment
from romsindy.diagnosis.on_beam import BeamReport
from romsindy.diagnosis.on_simulator import SimulatorReport
from romsindy.diagnosis.other_mode import InteractionReport
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.residual_report import CoupledDiagnosis, ForcedReport
from romsindy.effects import CATALOGUE
from romsindy.effects.base import Effect, Parameter, ReadingEffect, TermEffect, TimedEffect
