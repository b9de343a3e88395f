# The comparisons of large_chain_test.py at 10^5 elements.
#
# ranks: 2
# labels: long
# timeout: 300
from large_chain_test import LARGE, main

main(10 * LARGE)
