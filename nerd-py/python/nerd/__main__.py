"""The command line: `python -m nerd VERB`."""

import signal
import sys

from ._nerd import command

# Python code does not run during a verb, so it would not notice Ctrl-C.
signal.signal(signal.SIGINT, signal.SIG_DFL)
sys.exit(command(["python -m nerd", *sys.argv[1:]]))
