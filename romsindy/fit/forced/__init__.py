"""Fits to vibrations that measured inputs drive."""
