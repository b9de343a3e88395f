# The quick ones of the hard cases, each on one rank with the default solver.
#
# ranks: 2
# labels: hard
# timeout: 240
import sys

import hard

sys.exit(1 if hard.main(full=False) else 0)
