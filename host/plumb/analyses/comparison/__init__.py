"""Tilt errors of published algorithms and of plumb's systems, on recordings with a reference: `plumb compare`.

samples.py     counts that every algorithm gets, and the vertical that it should find
grades.py      errors of sensors of other grades, added to a recording, and samples that are lost
losses.py      which samples are lost
motions.py     prescribed motions that no recording has
published.py   VQF, BasicVQF, Madgwick and Mahony from PyPI
contenders.py  every algorithm by one interface: those, and the systems that have a compare.py
table.py       errors of every algorithm on every input
page.py        the table for a reader: text, JSON, report.html
"""
