# A shuffled 300 x 300 lattice, 450,000 unknowns, at 2, 3 and 5 ranks equals the one in order on one rank, and at most
# 5 % of what a random partition would cut is cut.
#
# ranks: 2
# labels: long
# timeout: 3600
from lattice_runs import compare

if __name__ == "__main__":
    compare(side=300, ranks=[2, 3, 5], random_cut_share=0.05)
