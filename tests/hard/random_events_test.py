# 20 random systems of all degrees and 10 of bouncing masses, by the hybrid scheme, against event-driven solutions in 60 digits.
#
# ranks: 1
# labels: hard
# timeout: 240
import sys

import random_runs

bad = random_runs.main("events", "quick", 20, tolerance=1e-8, perturbations=1)
bad += random_runs.main("impacts", "quick", 10, tolerance=1e-10, step=1.0, perturbations=1, bouncing=True)
sys.exit(bad)
