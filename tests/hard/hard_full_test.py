# All hard cases, on all their rank counts, with both SNESVI types and the default, and a million steps;
# random systems.
#
# ranks: 2
# labels: hard long
# timeout: 5400
import sys

import hard

sys.exit(1 if hard.main(full=True) + hard.random_systems("full") else 0)
