"""The blocks that methods are composed of: one module per step, in the order the data passes them."""
