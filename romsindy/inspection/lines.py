"""An inspection in words: tables and sentences."""

from __future__ import annotations
