"""A first look at a light field, before an estimate: order of the views, range of disparities."""
