"""Equations of motion from measured free decays."""
