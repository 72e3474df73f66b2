"""The sweep: one module per block of the paper's figure 3, in the order the data passes them."""
