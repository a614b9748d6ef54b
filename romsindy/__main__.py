"""``python -m romsindy``: the command, or versions for a bug report where none is given."""

import sys

from romsindy.commands.main import main
from romsindy.commands.versions import versions

if sys.argv[1:]:
    main()
else:
    print(versions())
