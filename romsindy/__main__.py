"""``python -m romsindy``."""

from romsindy.cli import main

main()
