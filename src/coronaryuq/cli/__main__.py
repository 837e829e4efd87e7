"""`python -m coronaryuq.cli`, where the command `coronaryuq` is not installed."""

import sys

from coronaryuq.cli.main import main

sys.exit(main())
