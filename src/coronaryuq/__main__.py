"""`python -m coronaryuq`, where the command `coronaryuq` is not on the path."""

import sys

from coronaryuq.cli.main import main

sys.exit(main())
