"""What physics says about a recording of a gyro and an accelerometer: clock, units, axes, signs, lags, the reference.

`audit.audit_of` takes plain arrays and needs no estimator and no board; `audited_files.load` reads a file, and can mend
what is sure.
"""
