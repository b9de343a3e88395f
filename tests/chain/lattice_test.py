# A shuffled 30 x 30 lattice at 2 and 3 ranks equals the one in order on one rank. A random cut has about side^2
# couplings, METIS's about `side`: a share of 2 / side at best, so 1/6 here.
#
# ranks: 2
# timeout: 240
from lattice_runs import compare

if __name__ == "__main__":
    compare(side=30, ranks=[2, 3], random_cut_share=1 / 6)
