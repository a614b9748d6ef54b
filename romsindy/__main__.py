"""``python -m romsindy``."""

from romsindy.commands.identify import main

main()
