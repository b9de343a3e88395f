# A column of 1000 balls that land one after the other on those below: see touching_balls_test.py.
#
# ranks: 1
# labels: long
# timeout: 600
from chain_runs import Verdict, program
from touching_balls_test import test_column

with program.temporary_folder() as name:
    verdict = Verdict()
    test_column(program.Path(name), 1000, 0.01, 1, verdict)
verdict.exit()
