"""What a user's own simulator lacks: the diagnosis beside an equation that stands for it."""

from romsindy.diagnosis.on_simulator.report import SimulatorReport
from romsindy.diagnosis.on_simulator.workflow import checked_values, diagnose_simulator
