"""Structures of finite elements: from a deck, or from arrays, to a reduced equation."""

from romsindy.structure.deck_file import DeckFile
from romsindy.structure.linear import Units
from romsindy.structure.simulator import Damping
from romsindy.structure.structure import Structure, load_structure
