"""``python -m romsindy``."""

from romsindy.commands.main import main

main()
