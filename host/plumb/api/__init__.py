"""The public Python API. Its names are those of `plumb`: `plumb.connect`, `plumb.run`, `plumb.Estimator`, ..."""
