"""Structures of finite elements: from a deck, or from arrays, to a reduced equation."""

from romsindy.structure.structure import Structure
