"""Engineering units, and the integers they are quantised to."""
