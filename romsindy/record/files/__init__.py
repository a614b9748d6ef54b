"""Recordings and decays from and to files."""

from romsindy.record.files.load import load_decay, load_forced, load_recording
from romsindy.record.files.save import save_decay
