"""
Quantities of trees, computed for several joints at once in SIMD lanes.

Derivatives, regressor and inverse have a second formulation here, for programs of one
state (`robot.kernel_set.method_in_lanes` chooses). The recursions of `recursive` can be
traced with lanes as scalars, with the vectors of eight joints that a link passes to its
parent in one row. But in link axes every link rotates and shifts these vectors, and the
next link waits for the result. In world axes about one origin a joint has fixed vectors,
each entry is one dot product of two of them, and sums along the tree take a number of
turns that grows with the logarithm of its depth (`tree_sums`). Of the derivatives of
inverse dynamics of random chains, the recursion with lanes as scalars takes 1.8 to 1.9
times as many instructions (24,700 instead of 13,000 for 30 axes, eight lanes); without
lanes it takes 69,000.
"""
