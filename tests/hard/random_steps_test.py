# 20 random systems of all degrees, stepped by HOMSP, against the same steps in 60 digits.
#
# ranks: 1
# labels: hard
import sys

import random_runs

sys.exit(random_runs.main("steps", "quick", 20))
