"""The command line: `python -m nerd VERB`."""

import signal
import sys

from ._nerd import command

# No Python code runs during a verb, so Python's handler would not see Ctrl-C.
signal.signal(signal.SIGINT, signal.SIG_DFL)
sys.exit(command(["python -m nerd", *sys.argv[1:]]))
