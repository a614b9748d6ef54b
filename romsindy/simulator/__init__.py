"""A user's own simulator of free decays: a function, an object or a program."""

from romsindy.simulator.program import Program
from romsindy.simulator.simulator import Simulator, SimulatorError
