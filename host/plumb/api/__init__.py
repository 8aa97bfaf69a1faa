"""The public Python API: what `plumb.connect`, `plumb.run`, `plumb.Estimator` and the other names of `plumb` are."""
